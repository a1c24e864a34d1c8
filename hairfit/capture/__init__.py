"""Photographs become numbers: cameras, masks, the head, orientation maps."""

from .capture import Capture as Capture
from .capture import View as View
from .capture import load_capture as load_capture
from .capture import require_for_fit as require_for_fit
from .photos import linear_from_srgb as linear_from_srgb
from .photos import srgb_from_linear as srgb_from_linear
from .scalp_file import load_scalp as load_scalp
from .scalp_file import save_scalp as save_scalp
from .select import choose_views as choose_views
