"""From the labels of a medical image to the closed surface of an organ.

    image = read_labels("seg.nii.gz")                        # NIfTI, NRRD, MetaImage, DICOM segmentation
    made = label_surface(image, choose_label(image, "liver"))
    write_ply("liver.ply", made.mesh)                        # in metres, x to the right, y to the front, z to the head

Needs the extra `scan`.
"""
