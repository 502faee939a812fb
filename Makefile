# Two commands do everything on a fresh machine with Python 3.11+, make and git: make demo, make test.
PYTHON ?= python3
DEMO_SECONDS ?= 0
FOOTAGE ?= ../shared/data
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
export PIP_DISABLE_PIP_VERSION_CHECK = 1

# What metrics, Sparkplug B and OPC UA are checked against. Without dependencies: opencv-python would overwrite ours, and
# pysparkplug asks for an older paho-mqtt, which what is used of it does not need. o6 is open62541 for Python; it is not free
# software (without a licence it may run for ten minutes at a time), so nothing but two tests knows it.
ORACLE := trackeval==1.3.0 pysparkplug==0.6.1 o6==2.2.0

# What some tests need beside Python: a third-party RTSP server, Prometheus with its checker, Alertmanager, a Modbus
# master, an MQTT broker, and
# the means to lose packets and to step a clock.
SYSTEM_PACKAGES := chromium mbpoll mosquitto mosquitto-clients prometheus prometheus-alertmanager kubernetes-client iproute2 iptables libfaketime python3-gi gir1.2-gst-rtsp-server-1.0 \
	gstreamer1.0-plugins-base gstreamer1.0-plugins-good gstreamer1.0-plugins-bad

# What the tests of the container need on top. `make test` does not install it: with the base to build from
# they take some seven minutes on two cores. Without podman or the base they are skipped and say so.
ENGINE_PACKAGES := podman buildah runc catatonit debootstrap
BASE ?= localhost/python:3.11-slim-bookworm

.PHONY: help setup demo test coverage quick container figures model pictures lint format bench viewers reproduce docs lock sbom release release-image sign verify audit system base clean

help: ## this list
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(READY) ## make the virtual environment in .venv

$(READY): pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "lumpwatch needs Python 3.11 or newer: make PYTHON=python3.12 …"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --requirement requirements.lock
	$(BIN)/pip install --quiet --no-deps --editable .
	@$(BIN)/pip install --quiet --no-deps $(ORACLE) || echo "$(ORACLE) cannot be installed: the tests that compare with it say so"
	@$(BIN)/python -m lumpwatch.service.cli.kernels || echo "kernels could not be compiled ahead: the first start takes some seconds longer"
	@touch $@

demo: setup ## a simulated crusher, watched live; DEMO_SECONDS=60 ends it by itself
	$(BIN)/lumpwatch demo $(if $(filter-out 0,$(DEMO_SECONDS)),--for $(DEMO_SECONDS)s)

# Those that start daemons and break them mostly wait, so they run beside the others; both share their work file by file.
DAEMONS := tests/faults tests/integration
WORKERS ?= 2
# In the order that tests/conftest.py gives: what takes long begins first.
SHARED = --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder

test: setup system ## all tests; those of `make container` where it was run before
	@mkdir -p build; $(BIN)/pytest $(DAEMONS) $(SHARED) >build/daemons.log 2>&1 & daemons=$$!; \
	$(BIN)/pytest $(SHARED) $(addprefix --ignore=,$(DAEMONS)); others=$$?; \
	wait $$daemons; code=$$?; cat build/daemons.log; exit $$((others | code))

coverage: setup system ## which lines the tests run that start no daemons; a table in build/coverage.txt
	@mkdir -p build
	$(BIN)/pytest $(SHARED) --cov --cov-report= $(addprefix --ignore=,$(DAEMONS))
	$(BIN)/coverage report --skip-covered --skip-empty --sort=cover | tee build/coverage.txt

container: setup base ## the image on a real engine: built, run, killed, upgraded, rolled back; as root
	LUMPWATCH_TEST_BASE=$(BASE) $(BIN)/pytest tests/container

figures: setup base ## what docs/deployment.md says of size, start, memory and gaps; as root
	LUMPWATCH_TEST_BASE=$(BASE) $(BIN)/python -m tests.container.figures

model: setup ## net and score that ship, from FOOTAGE; some hours; see docs/model-card.md
	$(BIN)/uv pip install --quiet --python $(BIN)/python --group model
	LUMPWATCH_FOOTAGE=$(FOOTAGE) $(BIN)/python -m tests.reproduction.real.make_feeds build/model/feeds --split train
	OMP_NUM_THREADS=1 $(BIN)/python -m lumpwatch.service.training.model_builder $(FOOTAGE) build/model/feeds/train build/model service/detection/default_lump.npz
	$(BIN)/python -m tests.reproduction.defaults

pictures: setup ## the pictures of README, docs/console.md and docs/dashboards.md; needs Debian's prometheus and chromium
	$(BIN)/python -m tests.reproduction.pictures
	$(BIN)/python -m tests.console.pictures
	$(BIN)/python -m tests.integration.pictures

# Where the image to build from is missing, it is made from Debian's packages.
base:
	@[ "$$(id -u)" = 0 ] || { echo "needs root, for podman and debootstrap"; exit 1; }
	@command -v podman >/dev/null && command -v debootstrap >/dev/null || \
		{ apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $(ENGINE_PACKAGES); }
	@podman image exists $(BASE) || tests/container/base.sh $(BASE)

quick: setup ## the fast tests only
	$(BIN)/pytest -m "not slow"

# mypy does not follow the mapping of an editable installation: it is shown the folders under their installed name.
TYPING := build/typing/lumpwatch

lint: setup ## style, types, and which package may import which
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@mkdir -p $(TYPING) && ln -sfn ../../../models $(TYPING)/models && ln -sfn ../../../service $(TYPING)/service
	$(BIN)/mypy
	$(BIN)/lint-imports

format: setup ## put the code into the project's format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: setup ## benchmarks, as ratios taken side by side
	$(BIN)/uv pip install --quiet --python $(BIN)/python --group bench || echo "Stone Soup cannot be installed: that comparison is left out"
	$(BIN)/python -m tests.benchmarks

SECONDS ?= 600
CAMERAS ?= 4
viewers: setup ## twenty viewers of the console on CAMERAS cameras for SECONDS: decisions with and without, memory, processor
	$(BIN)/python -m tests.console.load $(SECONDS) $(CAMERAS)

reproduce: setup ## the experiments, with tables and plots in docs/
	$(BIN)/python -m docs.experiments --footage $(FOOTAGE) --pages
	$(BIN)/python -m tests.reproduction

docs: setup ## the generated part of the documentation
	$(BIN)/python -m docs.generate
	$(BIN)/python -m docs.gallery

lock: setup ## resolve the dependencies anew
	$(BIN)/uv pip compile --quiet pyproject.toml --group dev --all-extras --universal --python-version 3.11 \
		--generate-hashes --no-header --no-emit-find-links --output-file requirements.lock
	$(BIN)/uv pip compile --quiet pyproject.toml --extra service --extra plot --extra console --extra gateway --universal --python-version 3.11 --constraint requirements.lock \
		--generate-hashes --no-header --no-emit-find-links --output-file deploy/container/requirements.lock

sbom: setup ## what the image is made of, as CycloneDX, into build/sbom.json
	@mkdir -p build
	$(BIN)/uv tool run --from cyclonedx-bom cyclonedx-py requirements --no-validate \
		--output-reproducible --output-file build/sbom.json deploy/container/requirements.lock

# The version stands in pyproject.toml alone, and the changelog must have its section: nothing is released as "Unreleased".
VERSION = $(shell sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)

release: sbom ## wheel, SBOM, changelog entry and checksums of this version, into dist/
	@! sed -n "/^## Unreleased/,/^## [0-9]/p" CHANGELOG.md | grep -q "^- " || { echo "CHANGELOG.md: what is Unreleased needs the version as its heading first"; exit 1; }
	@grep -q '^## $(VERSION)' CHANGELOG.md || { echo "CHANGELOG.md has no section of version $(VERSION)"; exit 1; }
	rm -rf dist && mkdir dist
	$(BIN)/uv build --quiet --wheel --out-dir dist
	cp build/sbom.json dist/lumpwatch-$(VERSION)-sbom.json
	cp deploy/container/requirements.lock dist/lumpwatch-$(VERSION)-requirements.lock
	awk '/^## /{on = index($$0, "## $(VERSION)") == 1} on' CHANGELOG.md >dist/lumpwatch-$(VERSION)-changes.md
	rm -f dist/.gitignore; cd dist && sha256sum lumpwatch-* >SHA256SUMS
	@cat dist/SHA256SUMS

# By digest, so that the same commit gives the same image; a tag moves.
ENGINE ?= docker
release-image: ## the image of this version: make release-image BASE=python:3.11-slim-bookworm@sha256:…; ENGINE=podman
	@case "$(BASE)" in *@sha256:*) ;; *) echo "BASE=$(BASE): a release is built from a base named by digest, NAME@sha256:…"; exit 1;; esac
	$(ENGINE) build $(if $(filter podman,$(ENGINE)),--format docker) --build-arg BASE=$(BASE) --build-arg VERSION=$(VERSION) \
		--build-arg REVISION=$$(git rev-parse HEAD) --build-arg CREATED=$$(git show -s --format=%cI HEAD) -t lumpwatch:$(VERSION) .
	@mkdir -p $(DIST) && { echo "base $(BASE)"; $(ENGINE) image inspect --format 'image {{.Id}} {{.Os}}/{{.Architecture}}' lumpwatch:$(VERSION); } \
		>$(DIST)/lumpwatch-$(VERSION)-image.txt && cat $(DIST)/lumpwatch-$(VERSION)-image.txt

# Of everything in DIST: who has the public key can tell that nothing was changed or put in place of it.
DIST ?= dist
sign: ## the checksums of DIST, signed: make sign KEY=release.key (openssl genpkey -algorithm EC -pkeyopt ec_paramgen_curve:P-256)
	@[ -n "$(KEY)" ] && [ -r "$(KEY)" ] || { echo "KEY=$(KEY): name the file of the private key"; exit 1; }
	cd $(DIST) && sha256sum lumpwatch-* >SHA256SUMS
	openssl dgst -sha256 -sign $(KEY) -out $(DIST)/SHA256SUMS.sig $(DIST)/SHA256SUMS
	openssl pkey -in $(KEY) -pubout -out $(DIST)/release.pub
	$(MAKE) --no-print-directory verify DIST=$(DIST) PUBLIC=$(DIST)/release.pub

verify: ## that DIST is as it was signed: make verify PUBLIC=release.pub, with a public key that came another way
	openssl dgst -sha256 -verify $(or $(PUBLIC),release.pub) -signature $(DIST)/SHA256SUMS.sig $(DIST)/SHA256SUMS
	cd $(DIST) && sha256sum --check --strict --quiet SHA256SUMS

audit: setup ## known vulnerabilities of what the image is made of; needs the advisory service
	$(BIN)/uv tool run pip-audit --strict --require-hashes --disable-pip --progress-spinner off \
		--requirement deploy/container/requirements.lock || \
		{ echo "audit: a vulnerability was found, or the advisory service cannot be asked (see above)"; exit 1; }

system:
	@if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
		dpkg -s $(SYSTEM_PACKAGES) >/dev/null 2>&1 || \
		{ apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $(SYSTEM_PACKAGES); } || \
		echo "system packages could not be installed; the tests that need them say so"; \
	else echo "not root: tests that need $(SYSTEM_PACKAGES) are skipped where these are missing"; fi

clean: ## remove everything that was made
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
