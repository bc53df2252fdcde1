"""Joint refinement of a pose on planes and pixels, after the fit of the paper."""
