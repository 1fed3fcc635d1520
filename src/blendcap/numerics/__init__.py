"""Mathematics that knows no face: exact box-constrained solves, geodesics, smoothing."""
