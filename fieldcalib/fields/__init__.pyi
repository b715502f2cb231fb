from .catalogue import FIELDS as FIELDS
from .catalogue import field_named as field_named
from .sports.tennis import tennis as tennis
