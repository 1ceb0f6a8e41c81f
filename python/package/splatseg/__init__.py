"""Every object in an RGB-D video gets one id that lasts for the whole video.

You pass in a camera's frames one by one, and an explicit 3D memory, an online Gaussian splat, remembers what was seen::

    import splatseg as ss

    seg = ss.FastSamSplat()
    for r in seg.run("drive.mcap", stride=2):
        print(r.name, [o.id for o in r.objects])
    seg.save("map.ply")

``seg.step(rgb, depth, K=K)`` takes in the frames of your own camera, and ``ss.run("drive.mcap", out="out")`` writes all
results to a folder, as the command ``splatseg run`` does.

Conventions: images are C-contiguous NumPy arrays, colour is RGB, depth is z-depth in metres with 0 where nothing was
measured, camera axes are x right, y down, z forward, poses are 4x4 matrices from camera to world. Id 0 means "nothing".

Settings are keyword arguments with the names listed by ``splatseg settings``: ``seed=3``, ``memory={"max_votes": 8}``
or ``**{"memory.max_votes": 8}``. An unknown keyword raises ``TypeError``, which suggests the most similar one.
"""

from . import rerun
from ._splatseg import __version__
from .evaluation import Scores, evaluate
from .floor_plan import ApproachPoint, Door, FloorPlan, Footprint, PlanRoom, Route
from .frame import Frame
from .live import Live
from .memory import Memory
from .merging import merge
from .naming import Names, names
from .objects import BestView, FoundObject, FrameStamp, Object, Objects, ObjectSighting, Shape, Sightings
from .pictures import segment_color
from .pipeline import FastSamSplat, Pipeline, Sam2Splat
from .predicted_depth import Depth, depth
from .result import StepResult
from .runs import Run, run
from .sam2 import Sam2, Tracks
from .saved_map import Mesh, SavedMap
from .scene import Scene, open_scene
from .scene_graph import LastSeen, Relation, SceneGraph, SceneObject, SceneRoom, load_scene_graph
from .segmenters import Affinity, FastSam, Graph, Segmenter
from .state import read_state

__all__ = [
    "Affinity",
    "ApproachPoint",
    "BestView",
    "Depth",
    "Door",
    "FastSam",
    "FastSamSplat",
    "FloorPlan",
    "Footprint",
    "FoundObject",
    "Frame",
    "FrameStamp",
    "Graph",
    "LastSeen",
    "Live",
    "Memory",
    "Mesh",
    "Names",
    "Object",
    "ObjectSighting",
    "Objects",
    "Pipeline",
    "PlanRoom",
    "Relation",
    "Route",
    "Run",
    "Sam2",
    "Sam2Splat",
    "SavedMap",
    "Scene",
    "SceneGraph",
    "SceneObject",
    "SceneRoom",
    "Scores",
    "Segmenter",
    "Shape",
    "Sightings",
    "StepResult",
    "Tracks",
    "__version__",
    "depth",
    "evaluate",
    "load_scene_graph",
    "merge",
    "names",
    "open_scene",
    "read_state",
    "rerun",
    "run",
    "segment_color",
]
