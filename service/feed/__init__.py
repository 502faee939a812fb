"""The simulated feed of a crusher: camera of the demo, video for training, bench for tests."""
