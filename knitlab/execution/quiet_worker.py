"""Preloaded by dask's workers: Ctrl-C is the run's business, and so are the messages about it."""

import logging
import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)
logging.getLogger("distributed").setLevel(logging.CRITICAL)
