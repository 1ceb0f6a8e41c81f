"""Writes furnished rooms as labelled RGB-D folders in ScanNet's exported layout, one room per seed.

    python -m splatseg_training.rooms --seed 101 --frames 80 --out DIR
    python -m splatseg_training.rooms --seed 6001 --rooms 60 --views scattered --frames 10 --no-colour --out DIR

Without --rooms, DIR is the room's folder. With --rooms, DIR gets one folder per room, named after its seed: DIR/6001 to
DIR/6060. Existing folders are kept. Depth and ids come from rays through the pixel centres, so they are exact. Ids 1 to
4 are walls, 5 is the floor, 6 the ceiling; objects.json names the others.
"""

import argparse
import os
import sys


def parse(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True, help="seed of the (first) room")
    parser.add_argument("--rooms", type=int, help="number of rooms, with consecutive seeds; one folder each")
    parser.add_argument("--out", required=True)
    parser.add_argument(
        "--frames", type=int, default=80, help="views of a room; fewer if a crowded one lacks good views"
    )
    parser.add_argument("--views", choices=["scattered", "path"], default="path", help="independent views, or a walk")
    parser.add_argument("--rate", type=float, help="Hz; samples the walk densely for video, instead of every 12 cm")
    parser.add_argument("--assets", metavar="DIR", help="folder of additional furniture meshes (DAE, glTF, FBX, OBJ)")
    parser.add_argument("--no-colour", action="store_true", help="only depth and ids, five times as fast")
    parser.add_argument(
        "--quick", action="store_true", help="colours by a simpler renderer, five times as fast; needs embreex"
    )
    parser.add_argument("--sensor-noise", action="store_true", help="noise and holes in the depth, like a Kinect's")
    parser.add_argument("--mesh", action="store_true", help="also the exact surfaces with their ids, surfaces.ply")
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--height", type=int, default=240)
    parser.add_argument("--samples", type=int, default=6, help="light paths per pixel")
    parser.add_argument("--threads", type=int, default=1, help="for rendering colours")
    options = parser.parse_args(arguments)
    if options.rate is not None and (options.views != "path" or options.rate <= 0):
        parser.error("--rate needs --views path and a positive number")
    if options.frames < 1 or options.rooms is not None and options.rooms < 1:
        parser.error("--frames and --rooms start at 1")
    if options.quick and options.no_colour:
        parser.error("--quick is about colours, which --no-colour leaves out")
    if options.quick and options.assets:
        parser.error("--quick cannot render the textures of --assets")
    return options


def main(arguments=None):
    options = parse(arguments)
    try:
        from .assets import Library
        from .write import Camera, Quality, Settings, write_room
    except ImportError as error:
        if error.name not in ("bpy", "mathutils", "PIL"):
            raise
        sys.exit(f"error: {error}; rooms need: pip install 'bpy==4.5.*' pillow")
    if options.quick:
        try:
            import embreex  # noqa: F401
        except ImportError as error:
            sys.exit(f"error: {error}; --quick needs: pip install embreex opencv-python-headless")
    settings = Settings(
        frames=options.frames,
        views=options.views,
        rate=options.rate,
        camera=Camera(options.width, options.height),
        colour=not options.no_colour,
        quick=options.quick,
        sensor_noise=options.sensor_noise,
        mesh=options.mesh,
        quality=Quality(options.samples, options.threads),
    )
    library = Library(options.assets) if options.assets else None
    for seed in range(options.seed, options.seed + (options.rooms or 1)):
        folder = os.path.join(options.out, str(seed)) if options.rooms else options.out
        print(write_room(folder, seed, settings, library), flush=True)


if __name__ == "__main__":
    main()
