"""The page `report.html` of a run folder: plain HTML and SVG, made with the standard library, nothing fetched."""
