"""Training samples made on the device: rooms are built, cast and degraded as batches of tensors, without any files.

In the order of their work: `draws` (random numbers), `parts` and `pieces` (boxes, cylinders and balls; what is built of
them), `furniture`, `fixtures` and `things` (the kinds), `layout`, `piles` and `views` (where they and the camera are),
`scenes` (all of it), `cast` (depth and ids), `colours` and `photograph`, `sensors`, `inputs`, `batches`, `train`. `fields`
has random fields and filters, `show` draws samples.
"""
