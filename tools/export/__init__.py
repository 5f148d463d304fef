"""What runs and checkpoints become for other people's tools: ONNX, and a folder for flatland-rl's own evaluator."""
