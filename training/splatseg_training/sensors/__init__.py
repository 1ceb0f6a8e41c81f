"""Depth sensors: the errors that cameras of many kinds add to the exact depth of a rendered view.

Each kind of error has a module with its parameters, a function that draws them and one that applies them:
`structured_light`, `stereo`, `lidar`, `time_of_flight`, `noise`, and, for all cameras, `registration` and `losses`.
`cameras` draws a camera for a sample: about half of the samples are clean to mild, because a good camera must not pay
for a bad one.
"""

from .cameras import measure

__all__ = ["measure"]
