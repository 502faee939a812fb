"""Where frames come from: RTSP streams, video files, folders of images, the simulated feed."""
