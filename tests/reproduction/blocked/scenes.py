"""What the figures are taken on: mouths that bridge, and mouths that only swallow."""

from __future__ import annotations

from dataclasses import dataclass, field

from lumpwatch.service.simulator import FeedSpec

FPS = 5.0
_PLACE: dict[str, object] = {"width": 320, "height": 240, "fps": FPS, "mouth_level": 0.4}
_WORK: dict[str, object] = {"hesitate_every_s": 15.0, "hesitate_longest_s": 4.0}
_BRIDGES: dict[str, object] = {"bridge_every_s": 14.0, "bridge_duration_s": 16.0}
_NIGHT: dict[str, object] = {"night": 0.7, "noise": 4.0}
_DUST: dict[str, object] = {"dust": 0.7, "dust_burst": 1.0, "dust_burst_every_s": 20.0}
_SHAKE: dict[str, object] = {"shake_px": 1.5}
_STOPS: dict[str, object] = {"stop_every_s": 40.0, "stop_duration_s": 20.0}


@dataclass(frozen=True, slots=True)
class Scene:
    """One scene, of which there are as many feeds as one likes."""

    name: str
    about: str
    seed: int
    changed: dict[str, object] = field(default_factory=dict)

    def spec(self, number: int = 0) -> FeedSpec:
        """Of its feed with that number: another place in another hour."""
        seed = self.seed + 1000 * number
        return FeedSpec.model_validate({**_PLACE, **_WORK, **self.changed, "seed": seed})


TUNING = Scene(
    "tuning",
    "bridges and normal crushing, for the peers' thresholds",
    900,
    {"bridge_every_s": 35.0, "bridge_duration_s": 20.0},
)
BLOCKED = (
    Scene("bridge", "the whole width bridges, the mouth 40 % full", 31, _BRIDGES),
    Scene("half", "half of the width bridges, the rest goes on", 33, {**_BRIDGES, "bridge_width": 0.5}),
    Scene("empty mouth", "nothing lies in it before", 35, {**_BRIDGES, "mouth_level": 0.0}),
    Scene("style b", "another place, camera and ore", 36, {**_BRIDGES, "style": "b"}),
    Scene("dust", "thick dust with bursts", 37, {**_BRIDGES, **_DUST}),
    Scene("shake", "the camera shakes by 1.5 px", 39, {**_BRIDGES, **_SHAKE}),
    Scene("night", "infra-red light, noise", 40, {**_BRIDGES, **_NIGHT}),
    Scene("stops", "the feed stops every 40 s for 20 s", 41, {**_BRIDGES, **_STOPS}),
    Scene(
        "lumps",
        "every other lump lodges in an empty mouth for 20 s",
        43,
        {"mouth_level": 0.0, "stuck_share": 0.5, "stuck_duration_s": 20.0, "lumps_per_minute": 5.0},
    ),
)
NORMAL = (
    Scene("plain", "holds back for up to 4 s every 15 s", 141),
    Scene("empty mouth", "all falls through", 143, {"mouth_level": 0.0}),
    Scene("full", "70 % full", 144, {"mouth_level": 0.7}),
    Scene("style b", "another place, camera and ore", 145, {"style": "b"}),
    Scene("dust", "thick dust with bursts", 146, _DUST),
    Scene("shake", "the camera shakes by 1.5 px", 147, _SHAKE),
    Scene("night", "infra-red light, noise", 148, _NIGHT),
    Scene("stops", "the feed stops every 40 s for 20 s", 149, _STOPS),
    Scene("gaps", "the belt is empty at times", 151, {"empty_every_s": 40.0, "empty_duration_s": 20.0}),
)
