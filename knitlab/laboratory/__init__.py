"""What a laboratory has: markers, machine curves and capacitances, brought into cubes."""
