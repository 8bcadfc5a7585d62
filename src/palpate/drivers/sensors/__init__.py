"""Force sensors: ATI's Net F/T over UDP. It measures; it takes no command."""
