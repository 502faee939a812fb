"""The bus: zenoh key expressions, codecs and sessions. No other package imports zenoh."""
