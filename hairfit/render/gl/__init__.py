"""Pictures for the eye, by OpenGL without a window."""

from .context import NoContextError as NoContextError
from .preview import PreviewStyle as PreviewStyle
from .preview import render_preview as render_preview
from .preview import turntable as turntable
