"""Known hair and pictures of it."""

from .head import head_distance as head_distance
from .head import make_head as make_head
from .head import make_scalp as make_scalp
from .picture import Light as Light
from .picture import Look as Look
from .scene import Scene as Scene
from .scene import write_capture as write_capture
from .styles import STYLES as STYLES
from .styles import make_style as make_style
