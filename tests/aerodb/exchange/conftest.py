"""Helpers of the tests of exchange files are importable."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # for daveml_files
