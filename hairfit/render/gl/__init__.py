"""Pictures for the eye, by OpenGL without a window."""

from .context import NoContextError as NoContextError
from .context import open_context as open_context
from .frame import Frames as Frames
from .pictures import draw_frames as draw_frames
from .pixels import FrameStyle as FrameStyle
