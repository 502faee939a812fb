#!/bin/sh
# Makes, from Debian's packages alone, an image that stands in for python:3.11-slim-bookworm where no registry
# of images can be reached. Needs root, debootstrap and podman; takes about a minute.
#
#   base.sh IMAGE [MIRROR_OF_DEBIAN]
#
# The machine's certificate authorities go with it, because the build downloads the dependencies.
set -eu
image=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

debootstrap --variant=minbase --include=ca-certificates,python3,python3-venv bookworm "$work/root" ${2:+"$2"} >"$work/log" 2>&1 ||
    { tail -n 5 "$work/log" >&2; exit 1; }
if [ -r /etc/ssl/certs/ca-certificates.crt ]; then
    cp -L /etc/ssl/certs/ca-certificates.crt "$work/root/etc/ssl/certs/ca-certificates.crt"
fi
tar -C "$work/root" --exclude='./var/cache/apt/*' --exclude='./var/lib/apt/lists/*' --exclude='./usr/share/doc/*' \
    --exclude='./usr/share/man/*' --exclude='./usr/share/locale/*' -c . |
    podman import --quiet --change 'CMD ["python3"]' --change 'ENV LANG=C.UTF-8' \
        --change 'ENV PATH=/usr/local/bin:/usr/local/sbin:/usr/sbin:/usr/bin:/sbin:/bin' \
        --change 'ENV PIP_CERT=/etc/ssl/certs/ca-certificates.crt' - "$image" >/dev/null
echo "made $image"
