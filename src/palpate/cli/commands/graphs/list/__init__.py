"""List nodes, messages, effects, tissues, material laws, and labels of a segmentation."""
