"""Laboratory records (markers, machine curves, capacitances) imported into cubes, and fits."""
