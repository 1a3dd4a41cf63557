"""The types of arrays, named by their elements, and the largest number that is read.

Shapes are in the docstrings of the functions that take them: the type checker does not know them.
"""

import numpy as np
from numpy.typing import NDArray

Elements = NDArray[np.generic]  # of any elements
Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Reals = NDArray[np.float32] | NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Records = NDArray[np.void]  # with named fields

MAX_MAGNITUDE = 1e18
"""The largest magnitude of numbers in files and expressions: the product of two is still a float32."""
