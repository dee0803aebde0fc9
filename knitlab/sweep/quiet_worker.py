"""Preloaded by dask's workers, which ignore Ctrl-C and log nothing: the run handles both."""

import logging
import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)
logging.getLogger("distributed").setLevel(logging.CRITICAL)
