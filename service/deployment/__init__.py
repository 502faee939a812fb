"""Rolling the daemon out as a container: `lumpwatch deploy`. Only `engine` knows the container engine."""
