"""How an RTSP camera is entered: certificates, challenges, and the wait for the first key frame."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import time
from pathlib import Path

import pytest
from pydantic import ValidationError

from lumpwatch.service.capture.sources.base import Fault
from lumpwatch.service.capture.sources.rtsp_auth import best, challenges, in_words, needs_help
from lumpwatch.service.capture.sources.rtsp_relay import place_of
from lumpwatch.service.config import SourceConfig
from tests.capture.test_rtsp_streams import Camera
from tests.servers.clips import write_clip
from tests.servers.process import RtspServer

PASSWORD = "geheim"


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clip(tmp_path_factory.mktemp("clip") / "clip.mp4", frames=50, gop=10)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`ca.pem` has signed `cam.pem` for 127.0.0.1 and `other.pem` for another host."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    folder = tmp_path_factory.mktemp("certificates")

    def openssl(*arguments: str) -> None:
        subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True, timeout=60)

    key = ("-newkey", "rsa:2048", "-nodes")
    openssl("req", "-x509", *key, "-keyout", "ca.key", "-out", "ca.pem", "-subj", "/CN=ca", "-days", "2")
    for name, host in (("cam", "IP:127.0.0.1"), ("other", "DNS:other.example")):
        openssl("req", *key, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}")
        (folder / "ext").write_text(f"subjectAltName={host}\n")
        signed = ("-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2", "-extfile", "ext")
        openssl("x509", "-req", "-in", f"{name}.csr", "-out", f"{name}.pem", *signed)
    return folder


def with_login(url: str) -> str:
    return url.replace("://", f"://eye:{PASSWORD}@")


def served(clip: Path, certificates: Path, name: str) -> RtspServer:
    files = ("--cert", str(certificates / f"{name}.pem"), "--key", str(certificates / f"{name}.key"))
    return RtspServer(clip, user="eye", password=PASSWORD, more=files)


def test_a_certificate_is_verified_and_the_host_it_is_for(clip: Path, certificates: Path) -> None:
    ours = {"ca": certificates / "ca.pem"}
    with served(clip, certificates, "cam") as server, served(clip, certificates, "other") as other:
        url = with_login(server.url)
        unknown = Camera(url).fault()
        assert unknown.fault is Fault.CERTIFICATE
        assert "certificate is refused: " in str(unknown)
        assert PASSWORD not in str(unknown)
        with Camera(url, tls=ours) as camera:
            assert len(camera.opened().read(5)) == 5
        foreign = Camera(with_login(other.url), tls=ours).fault()
        assert foreign.fault is Fault.CERTIFICATE
        assert "127.0.0.1" in str(foreign)
        with Camera(with_login(other.url), tls={"insecure": True}) as camera:
            assert len(camera.opened().read(5)) == 5


@pytest.mark.parametrize(
    ("url", "tls", "why"),
    [
        ("rtsp://h/s", {"insecure": True}, "tls is for rtsps"),
        ("film.mp4", {"ca": "ca.pem"}, "tls is for rtsps"),
        ("rtsps://h/s", {"ca": "ca.pem", "insecure": True}, "contradict"),
        ("rtsps://h/s", {"verify": False}, "verify"),
    ],
)
def test_tls_of_a_source_that_makes_no_sense_is_refused(url: str, tls: object, why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        SourceConfig.model_validate({"url": url, "tls": tls})


@pytest.mark.parametrize("offers", ["SHA-256", "MD5,SHA-256"])
def test_a_right_password_is_let_in_whatever_digest_is_offered(clip: Path, offers: str) -> None:
    with RtspServer(clip, user="eye", password=PASSWORD, more=("--offers", offers)) as server:
        with Camera(with_login(server.url)) as camera:
            assert len(camera.opened().read(30)) == 30
        wrong = Camera(with_login(server.url).replace(PASSWORD, "falsch")).fault()
        assert wrong.fault is Fault.UNAUTHORISED


def test_sha_256_over_tls(clip: Path, certificates: Path) -> None:
    files = ("--cert", str(certificates / "cam.pem"), "--key", str(certificates / "cam.key"))
    with RtspServer(clip, user="eye", password=PASSWORD, more=("--offers", "SHA-256", *files)) as server:
        with Camera(with_login(server.url), tls={"ca": certificates / "ca.pem"}) as camera:
            assert len(camera.opened().read(5)) == 5
        assert Camera(with_login(server.url)).fault().fault is Fault.CERTIFICATE


def test_what_the_camera_offers_is_said(clip: Path) -> None:
    with RtspServer(clip, user="eye", password=PASSWORD, more=("--offers", "SHA-512,basic2")) as server:
        told = str(Camera(with_login(server.url)).fault())
        assert "digest SHA-512" in told
    with RtspServer(clip, user="eye", password=PASSWORD, more=("--offers", "SHA-256")) as server:
        assert "transport: tcp" in str(Camera(with_login(server.url), transport="udp").fault())
        asked = str(Camera(server.url).fault())
        assert "asks for user and password (the camera offers digest SHA-256)" in asked


def test_a_key_frame_that_is_long_in_coming_is_waited_for(tmp_path: Path) -> None:
    """It joins in the middle: the next key frame comes after more than a read time-out."""
    film = write_clip(tmp_path / "long.mp4", frames=75, gop=75)
    with RtspServer(film, more=("--join-anywhere",)) as server:
        time.sleep(0.3)  # into the group of pictures
        with Camera(server.url, read_timeout_s=0.6) as camera:
            assert len(camera.opened().read(3)) == 3
            assert camera.counts["corrupt"] == 0


def test_the_examples_of_the_standard() -> None:
    """RFC 7616, 3.9.1: both answers of Mufasa, with the nonce's counter and the client's nonce as there."""
    nonce = "7ypf/xlj9XXwfDPEoM4URrv/xwf94BcCAzFZH4GiTo0v"
    common = (
        f'Digest realm="http-auth@example.org", qop="auth, auth-int", algorithm={{}}, nonce="{nonce}", '
        'opaque="FQhe/qaU925kfnzjCev0ciny7QMkPqMAFRtzCUYo5tdS"'
    )
    offered = challenges([common.format("SHA-256"), common.format("MD5")])
    assert [one.algorithm for one in offered] == ["SHA-256", "MD5"]
    chosen = best(offered)
    assert chosen is offered[0]
    answer = chosen.answer("Mufasa", "Circle of Life", "GET", "/dir/index.html")
    fields = dict(part.split("=", 1) for part in answer.removeprefix("Digest ").replace('"', "").split(", "))
    secret = hashlib.sha256(b"Mufasa:http-auth@example.org:Circle of Life").hexdigest()
    what = hashlib.sha256(b"GET:/dir/index.html").hexdigest()
    whole = f"{secret}:{nonce}:00000001:{fields['cnonce']}:auth:{what}"
    assert fields["response"] == hashlib.sha256(whole.encode()).hexdigest()
    assert fields["qop"] == "auth"
    assert fields["opaque"].startswith("FQhe")


@pytest.mark.parametrize(
    ("headers", "chosen", "help_needed"),
    [
        (["Basic realm=x"], "BASIC", False),
        (['Digest realm="x", nonce="n"', "Basic realm=x"], "MD5", False),
        (['Digest realm="x", nonce="n", algorithm=SHA-512'], None, False),
        (['Digest realm="x", nonce="n", qop="auth-int"'], None, False),
        (['Digest realm="x"'], None, False),
        (["Bearer", ""], None, False),
        (['Digest nonce="n", algorithm=SHA-256', 'Digest nonce="n", algorithm=MD5'], "SHA-256", True),
    ],
)
def test_the_best_way_in_is_chosen(headers: list[str], chosen: str | None, help_needed: bool) -> None:
    offered = challenges(headers)
    found = best(offered)
    assert (None if found is None else found.algorithm) == chosen
    assert needs_help(offered) is help_needed
    assert "\x1b" not in in_words(challenges(["\x1b[2J"]))


def test_an_address_taken_apart() -> None:
    place = place_of("rtsps://a%40b:c%2Fd@[::1]:8322/live?ch=1")
    assert (place.user, place.password, place.host, place.port) == ("a@b", "c/d", "::1", 8322)
    assert place.base + place.rest == "rtsp://[::1]:8322/live?ch=1"
    assert place_of("rtsp://h/s").port == 554
    assert place_of("rtsps://h/s").port == 322
