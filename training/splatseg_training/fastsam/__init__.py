"""Training of FastSAM's network: YOLOv8-seg with one class, written from the papers cited in the modules."""
