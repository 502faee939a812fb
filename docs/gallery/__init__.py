"""Short scripts that use `lumpwatch.models` alone, each with a picture: `make docs` builds the pictures."""
