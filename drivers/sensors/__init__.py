"""Force sensors: ATI's Net F/T over UDP, Bota's over a serial line. They measure; they take no command."""
