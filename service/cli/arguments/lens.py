"""Arguments of `lumpwatch lens`."""

from __future__ import annotations

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Commands, add_command, add_json, picture_size


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "lens",
        late("lens", "lens"),
        "Find how a lens bends the picture (calibration.lens) from edges that are straight in the world: skirts of the "
        "belt, beams, walls, by three points each or more, far from the picture's middle.",
        "lumpwatch lens 1920x1080 --edge 80,40 38,540 80,1040 --edge 1840,40 1882,540 1840,1040",
    )
    parser.add_argument("size", type=picture_size, metavar="WIDTHxHEIGHT", help="size of the picture, px")
    parser.add_argument(
        "--edge",
        action="append",
        nargs="+",
        required=True,
        metavar="X,Y",
        help="points of one edge, px; may be given again",
    )
    add_json(parser)
