"""Design: stripes and sizes that come closest to a wish, by simulation and adjoint gradients."""
