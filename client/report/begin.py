"""Imported by the programs that draw, before libraries that take long to load: until the command line is read an interrupt
ends the program at once, in one line. Not for what hosts import, which have handlers of their own."""
import signal

import terminal

terminal.exchange_handlers(signal.default_int_handler, terminal.end_at_once)
