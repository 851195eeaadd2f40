"""The map for language agents: a server of the Model Context Protocol on standard input and output."""
