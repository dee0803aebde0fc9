"""Design: stripes and sizes that come closest to targets, by simulation and adjoint gradients."""
