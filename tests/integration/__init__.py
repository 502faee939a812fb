"""The whole product: real processes, a real RTSP server, a real bus."""
