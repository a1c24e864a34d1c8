import pathlib
import sys

# The helpers of these tests stand beside them.
sys.path.insert(0, str(pathlib.Path(__file__).parent))
