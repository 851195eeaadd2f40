"""Types of arrays that stand in most signatures."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
