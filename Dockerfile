# The daemon as a container: not root, read-only, no shell needed, nothing downloaded or compiled at run time.
#
#   docker build -t lumpwatch .
#   docker run --read-only --cap-drop ALL --security-opt no-new-privileges --shm-size 64m \
#       --tmpfs /tmp -v lumpwatch:/var/lib/lumpwatch -v ./site.yaml:/etc/lumpwatch/site.yaml:ro lumpwatch
#
# BASE can be any image with Python 3.11 or newer, its venv module and glibc; sites with a mirror name theirs, and a
# release names it by digest: `make release-image` refuses any other. linux/amd64 is built and tested; see
# docs/deployment.md for arm64.
ARG BASE=docker.io/library/python:3.11-slim-bookworm

# Dependencies: a layer that changes with the lock file alone.
FROM ${BASE} AS dependencies
WORKDIR /source
COPY deploy/container/requirements.lock ./
RUN python3 -m venv /opt/lumpwatch && \
    /opt/lumpwatch/bin/pip install --no-cache-dir --no-compile --disable-pip-version-check --require-hashes -r requirements.lock && \
    echo /opt/lumpwatch-code >"$(/opt/lumpwatch/bin/python -c 'import site; print(site.getsitepackages()[0])')/lumpwatch-code.pth"

# Our code, and the kernels compiled for any processor of the architecture: no site compiles them again.
FROM dependencies AS code
COPY pyproject.toml README.md LICENSE ./
COPY models models
COPY service service
ENV NUMBA_CPU_NAME=generic NUMBA_CACHE_DIR=/opt/lumpwatch-code/kernels
RUN /opt/lumpwatch/bin/pip install --no-cache-dir --no-compile --disable-pip-version-check --no-deps --target /opt/lumpwatch-code . && \
    /opt/lumpwatch/bin/python -m lumpwatch.service.cli.kernels --all && \
    find /opt/lumpwatch-code -type d -name __pycache__ -prune -exec rm -rf {} + && \
    python3 -m compileall -q -j 0 /opt/lumpwatch-code

# What no running program reads goes: tests, headers, sources of compiled parts, type stubs, sample data.
FROM dependencies AS slim
RUN /opt/lumpwatch/bin/pip uninstall --yes --quiet pip setuptools && \
    find /opt/lumpwatch -type d \( -name tests -o -name __pycache__ -o -name sample_data \) -prune -exec rm -rf {} + && \
    find /opt/lumpwatch -type f \( -name '*.h' -o -name '*.hpp' -o -name '*.a' -o -name '*.c' -o -name '*.pxd' \
        -o -name '*.pyx' -o -name '*.pyi' \) -delete && \
    find /opt/lumpwatch/bin -type f -delete && \
    python3 -m compileall -q -j 0 /opt/lumpwatch && \
    mkdir -p /empty/var/lib/lumpwatch

FROM ${BASE}
# Nothing can be installed into what runs.
RUN if python3 -m pip --version >/dev/null 2>&1; then \
        python3 -m pip uninstall --yes --quiet --root-user-action ignore pip setuptools wheel; fi
COPY --from=slim /opt/lumpwatch /opt/lumpwatch
COPY --from=slim --chown=10001:10001 /empty/var/lib/lumpwatch /var/lib/lumpwatch
COPY --from=code /opt/lumpwatch-code /opt/lumpwatch-code
# Kernels are put into the store's volume at the start, since numba reads them only where it could write.
ENV PATH=/opt/lumpwatch-code/bin:/opt/lumpwatch/bin:/usr/local/bin:/usr/bin:/bin \
    PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 NUMBA_CPU_NAME=generic LUMPWATCH_KERNELS=/opt/lumpwatch-code/kernels \
    NUMBA_CACHE_DIR=/var/lib/lumpwatch/kernels MPLCONFIGDIR=/tmp HOME=/tmp
ARG VERSION=0.1.0
ARG REVISION=unknown
ARG CREATED=1970-01-01T00:00:00Z
LABEL org.opencontainers.image.title="lumpwatch" \
      org.opencontainers.image.description="Watches the feed of a crusher and says in time that a large lump is coming" \
      org.opencontainers.image.licenses="Apache-2.0" \
      org.opencontainers.image.version="${VERSION}" \
      org.opencontainers.image.revision="${REVISION}" \
      org.opencontainers.image.created="${CREATED}"
USER 10001:10001
VOLUME /var/lib/lumpwatch
EXPOSE 7447 9464
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=15s --timeout=10s --start-period=60s --retries=3 \
    CMD ["lumpwatch", "health", "/etc/lumpwatch/site.yaml"]
ENTRYPOINT ["lumpwatch"]
CMD ["run", "/etc/lumpwatch/site.yaml"]
