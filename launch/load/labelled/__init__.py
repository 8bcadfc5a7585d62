"""What the labels of a segmentation say about an organ: its tissue, and a nodule inside of it."""
