"""Maps in other programs' formats; each file writes one."""
