from .edit import Known as Known
from .editor import Editor as Editor
from .frame import FrameEditor as FrameEditor
