import pathlib
import sys

# Scripts, not a package: they import each other as what stands beside them.
sys.path.append(str(pathlib.Path(__file__).parents[2] / "benchmarks"))
