"""The parts of a simulated feed, put together as the feed does it."""

from __future__ import annotations

from dataclasses import dataclass

from lumpwatch.service.simulator.gaps import Gaps
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.motion import BeltMotion
from lumpwatch.service.simulator.scene import Scene
from lumpwatch.service.simulator.site import Site
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.stock import Stock
from lumpwatch.service.simulator.traffic import Traffic
from lumpwatch.service.simulator.weather import Weather


@dataclass(frozen=True, slots=True)
class Parts:
    """What draws a feed."""

    scene: Scene
    weather: Weather
    stock: Stock
    traffic: Traffic


def parts(spec: FeedSpec) -> Parts:
    geometry, belt, gaps = Geometry.of(spec), BeltMotion(spec), Gaps(spec)
    site = Site(spec, geometry)
    scene = Scene(spec, geometry, belt, site, gaps)
    weather = Weather(spec, site.light(), geometry.lip_row)
    stock = Stock(spec, geometry, site.view, scene.bed)
    return Parts(scene, weather, stock, Traffic(spec, geometry, belt, stock, gaps))
