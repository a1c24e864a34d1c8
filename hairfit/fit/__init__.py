"""From numbers to a hair tree."""

from .derive import derive_strands as derive_strands
from .pipeline import FitConfig as FitConfig
from .pipeline import FitResult as FitResult
from .pipeline import fit_capture as fit_capture
