"""A prior on trial: it runs beside the one in use, is compared with it, and decides nothing."""
