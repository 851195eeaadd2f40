from edgemap.runtime.extras import need

need("plot", "drawing", ("matplotlib",))
