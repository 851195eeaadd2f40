from edgemap.runtime.frames.extras import need

need("plot", "drawing")
