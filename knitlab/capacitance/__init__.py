"""Capacitance of electrodes on a fabric by boundary elements, and its figures as a sensor."""
