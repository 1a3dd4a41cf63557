"""Types of NumPy arrays for annotations, named by their elements, and the limit of numbers that are read from files.

These types do not include shapes; the docstrings of functions state the shapes of their arrays.
"""

import numpy as np
from numpy.typing import NDArray

Elements = NDArray[np.generic]  # elements of any type
Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Reals = NDArray[np.float32] | NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Records = NDArray[np.void]  # records with named fields

MAX_MAGNITUDE = 1e18
"""The largest magnitude of numbers in files and expressions: the product of two is still a float32."""
