"""Faults of the network between the camera and the process that reads it."""

from __future__ import annotations

import os
import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import pytest

from tests.faults.pictures import FPS, Pictures, camera, failures, row, run_fault, watching, write_clip
from tests.faults.proxy import SlowProxy
from tests.faults.table import Record, Row
from tests.integration.site import wait_for
from tests.servers.process import RtspServer

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

NAMESPACE, LINK = "lumpwatch-test", "lwtest"
NEAR, FAR = "10.213.7.1", "10.213.7.2"


class LossyNetwork:
    """A network namespace that this host reaches over a link of which packets can be lost."""

    def __enter__(self) -> LossyNetwork:
        self._run(f"ip netns add {NAMESPACE}")
        self._run(f"ip link add {LINK}0 type veth peer name {LINK}1")
        self._run(f"ip link set {LINK}1 netns {NAMESPACE}")
        self._run(f"ip addr add {NEAR}/24 dev {LINK}0")
        self._run(f"ip link set {LINK}0 up")
        self.inside(f"ip addr add {FAR}/24 dev {LINK}1")
        self.inside(f"ip link set {LINK}1 up")
        self.inside("ip link set lo up")
        return self

    def __exit__(self, *_: object) -> None:
        subprocess.run(["ip", "netns", "del", NAMESPACE], check=False, capture_output=True)
        subprocess.run(["ip", "link", "del", f"{LINK}0"], check=False, capture_output=True)

    def inside(self, command: str) -> str:
        """Run a command in the namespace; what it printed."""
        return self._run(f"ip netns exec {NAMESPACE} {command}")

    def lose(self, share: float) -> None:
        """Lose this share of the packets that leave the namespace; 0 ends it."""
        self.inside("iptables -F OUTPUT")
        self.inside("iptables -Z OUTPUT")
        if share:
            self.inside(f"iptables -A OUTPUT -m statistic --mode random --probability {share} -j DROP")

    def lost(self) -> tuple[float, int]:
        """The share of packets lost since `lose` was called, and of how many, by the kernel's counters."""
        table = self.inside("iptables -nvxL OUTPUT")
        passed = int(re.search(r"policy ACCEPT (\d+) packets", table)[1])  # type: ignore[index]
        dropped = sum(int(line.split()[0]) for line in table.splitlines() if " DROP " in line)
        return dropped / (dropped + passed), dropped + passed

    def _run(self, command: str) -> str:
        return subprocess.run(command.split(), check=True, capture_output=True, text=True).stdout


def no_network() -> str | None:
    """Why there can be no lossy network here; None where it can be."""
    if os.geteuid() != 0:
        return "packet loss needs root: a network namespace and iptables"
    try:
        with LossyNetwork() as network:
            network.lose(0.5)
    except (OSError, subprocess.CalledProcessError) as error:
        return f"packet loss needs a network namespace and iptables with its statistic module: {error}"
    return None


@dataclass
class Site(Pictures):
    """With what lies between the cameras `slow` and `lossy` and their servers."""

    proxy: SlowProxy
    network: LossyNetwork | str
    """Where there is none: why."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("networks")
    clip = write_clip(folder / "clip.mp4")
    with ExitStack() as stack:
        server = stack.enter_context(RtspServer(clip))
        proxy = stack.enter_context(SlowProxy(server.port))
        url = server.url.replace(str(server.port), str(proxy.port))
        cameras = {"slow": camera("slow", url, max_age_s=0.8)}
        network: LossyNetwork | str = no_network() or stack.enter_context(LossyNetwork())
        if isinstance(network, LossyNetwork):
            run_by = ("ip", "netns", "exec", NAMESPACE)
            far = stack.enter_context(RtspServer(clip, host=FAR, run_by=run_by))
            cameras["lossy"] = camera("lossy", far.url, transport="udp")
        seen = stack.enter_context(watching(folder, cameras, tuple(cameras)))
        yield Site(seen.daemon, seen.outside, proxy, network)


def test_the_network_is_slow(site: Site, record: Record) -> None:
    def slow_down() -> None:
        site.proxy.delay_s = 3.0

    def end() -> None:
        site.proxy.delay_s = 0.0

    def still_blind() -> None:
        # It must not take a stream for fresh that only begins anew: give it the time to try.
        counted = failures(site, "slow", "open_timeout")
        wait_for("connection refused as too slow", lambda: counted() >= 1, 30)

    course = run_fault(site, "slow", slow_down, still_blind, end)
    record(
        row(
            "network delay",
            "a proxy holds back all that the RTSP server sends by 3 s (`max_age_s` 0.8), until connecting failed too",
            "source failure `open_timeout`",
            "connects by itself",
            course,
        )
    )


def test_some_packets_are_lost(site: Site, record: Record) -> None:
    if isinstance(site.network, str):
        pytest.skip(site.network)
    outside = site.outside

    def received() -> float:
        return site.metric("lumpwatch_frames_received_total", "lossy")

    site.network.lose(0.2)
    began, before = time.monotonic(), received()
    outside.raised("lossy", began)
    outside.raised("lossy", time.monotonic())
    rate, (lost, packets) = (received() - before) / (time.monotonic() - began), site.network.lost()
    site.network.lose(0.0)
    # How many pictures this costs depends on how many packets each one takes: that is reported, not asked.
    assert abs(lost - 0.2) < 0.05 + 3.5 * (0.2 * 0.8 / packets) ** 0.5
    # By chance so many packets in a row are lost that the stream stops, or that too few pictures are whole to find a
    # lump by; then, and only then, it may be blind, and until it has looked again.
    reasons = {one.reason for one in outside.since("lossy", began) if one.state == "BLIND"}
    assert reasons <= {"no_stream", "starting", "few_frames"}
    record(
        Row(
            "20 % of packets lost", "iptables' statistic module in a network namespace, RTP over UDP",
            f"decisions go on with {100 * rate / FPS:.0f} % of the frames, lumps are announced", None, None,
            outside.lost(site.store, "lossy"), "nothing to recover from", None, None,
        )
    )  # fmt: skip


def test_most_packets_are_lost(site: Site, record: Record) -> None:
    if isinstance(site.network, str):
        pytest.skip(site.network)
    network = site.network
    course = run_fault(site, "lossy", lambda: network.lose(0.8), end=lambda: network.lose(0.0))
    record(
        row(
            "80 % of packets lost",
            "the same link loses as many until BLIND is seen",
            "frames too few to find a lump by",
            "connects by itself",
            course,
        )
    )


def test_all_packets_are_lost(site: Site, record: Record) -> None:
    if isinstance(site.network, str):
        pytest.skip(site.network)
    network = site.network
    course = run_fault(site, "lossy", lambda: network.lose(1.0), end=lambda: network.lose(0.0))
    record(
        row(
            "all packets lost",
            "the same link loses everything until BLIND is seen",
            "source failure `read_timeout`",
            "connects by itself",
            course,
        )
    )
