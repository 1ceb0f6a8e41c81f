"""Training of FastSAM's network: YOLOv8-seg with one class, written from the papers that the modules name."""
