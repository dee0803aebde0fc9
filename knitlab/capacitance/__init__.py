"""Capacitance of electrodes on a fabric by boundary elements, and figures of merit as a sensor."""
