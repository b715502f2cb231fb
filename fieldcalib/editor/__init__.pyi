from .editor import Editor as Editor
from .frame import FrameEditor as FrameEditor
from .known_camera import Known as Known
