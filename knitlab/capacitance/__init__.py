"""Capacitance of conductors on a fabric, by boundary elements; what a capacitor is as a sensor."""
