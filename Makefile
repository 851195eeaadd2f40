# `make run` and `make view` install what they need; everything else builds on `make setup`, which has every extra.
# Each may be called again at any time.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.edgemap-setup
BASE := $(VENV)/.edgemap-base
VIEW := $(VENV)/.edgemap-view
FOXGLOVE := $(VENV)/.edgemap-foxglove
SITE := $(VENV)/.edgemap-site
PINS := pyproject.toml constraints.txt
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
ROOMS := geometry runtime bridges calibrate evaluation simulation export benchmarks plots view cli
unexport PYTHONDONTWRITEBYTECODE # else every process that a test starts compiles its modules again
SYSTEM := libusb-1.0-0 libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri sweethome3d-furniture

.PHONY: setup system run view foxglove test check lint audit docs bench figures reliability paper-tables demo demo-drive sbom release release-check integration clean

setup: system $(STAMP)

$(STAMP): $(PINS) scripts/system-packages scripts/pip-install
	@$(venv)
	@echo "edgemap: installing every extra and the development tools into $(VENV) (torch is most of it) ..."
	@scripts/pip-install $(BIN)/python -c constraints.txt -e '.[all,dev]'
	@$(rooms)
	@touch $(STAMP)

# What a robot needs: no torch, no renderer, no browser, no development tools.
$(BASE): $(PINS)
	@$(venv)
	@echo "edgemap: installing numpy, scipy, OpenCV, onnxruntime and edgemap into $(VENV) ..."
	@$(PIP) --no-compile -e .
	@touch $(BASE)

$(VIEW): $(BASE)
	@echo "edgemap: installing what the live page needs ..."
	@$(PIP) --no-compile -e '.[view]'
	@touch $(VIEW)

$(FOXGLOVE): $(BASE)
	@echo "edgemap: installing Foxglove's server ..."
	@$(PIP) --no-compile -e '.[foxglove]'
	@touch $(FOXGLOVE)

# The API reference is read from the sources, without importing them.
$(SITE): $(BASE)
	@echo "edgemap: installing what the site needs ..."
	@$(PIP) --no-compile mkdocs-material 'mkdocstrings[python]'
	@$(rooms)
	@touch $(SITE)

define venv
$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "needs Python 3.11 or newer"; exit 1; }; \
$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || scripts/system-packages python3-venv; \
$(PYTHON) -c 'import ensurepip, venv' || { echo "needs Python's venv: apt-get install python3-venv"; exit 1; }; \
test -x $(BIN)/python || { echo "edgemap: making $(VENV) ..."; $(PYTHON) -m venv $(VENV); }
endef

# Every room under one package, as a checker of types and the site's reference read them.
define rooms
mkdir -p .typing/edgemap; \
for room in $(ROOMS); do ln -sfn ../../$$room .typing/edgemap/$$room; done; \
for file in __init__.py opening.py py.typed; do ln -sfn ../../api/$$file .typing/edgemap/$$file; done
endef

# Where the complete setup was made, it is kept up to date instead.
installed = $(if $(wildcard $(STAMP)),$(STAMP),$(1))

system:
	@scripts/system-packages $(SYSTEM)

run: $(call installed,$(BASE))
	@echo "edgemap: driving the demo, one minute in a rendered home ..."
	$(BIN)/edgemap run

# The demo's live page: open the address that it prints; Ctrl-C ends it. Beyond this machine: make view VIEW_HOST=0.0.0.0
VIEW_HOST ?= 127.0.0.1
VIEW_PORT ?= 8090
view: $(call installed,$(VIEW))
	$(BIN)/edgemap run --view $(VIEW_HOST):$(VIEW_PORT)

# The live page's tests drive a real browser, MQTT's a real broker, those of ROS 2 a program built against Fast DDS; without
# one they are skipped and say so.
# A worker that crashes ends the suite: with another in its place, pytest-xdist ran its tests again and again, or hung.
test: setup
	@scripts/system-packages chromium mosquitto mosquitto-clients g++ libfastrtps-dev libfastcdr-dev
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --max-worker-restart=0

# Two minutes on two idle cores, after an edit: lint beside the tests of the geometry, the metrics, the step and the pages.
QUICK := tests/geometry tests/evaluation tests/runtime/test_pipeline.py tests/runtime/test_mapper.py \
	tests/runtime/test_config.py tests/test_docs.py tests/test_packages.py
check: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	PYTHONPATH=.typing $(BIN)/lint-imports
	@$(BIN)/pyright & types=$$!; $(BIN)/python -m pytest -q -n 2 $(QUICK); tests=$$?; wait $$types && exit $$tests

# The demo live in Foxglove's protocol, on ws://127.0.0.1:8765.
foxglove: $(call installed,$(FOXGLOVE))
	$(BIN)/edgemap run --foxglove

lint: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/pyright --threads 2
	PYTHONPATH=.typing $(BIN)/lint-imports  # .typing/ shows every room under one package

# The whole site, API reference included, into site/.
docs: $(call installed,$(SITE))
	$(BIN)/python -m mkdocs build --clean

bench: setup
	$(BIN)/edgemap bench --against openvino
	$(BIN)/edgemap bench --bundle yolox-nano --against openvino

# The figures of README and models/README whose data is here, into runs/figures/; prints the commands of all.
# One of them: make figures FIGURES=demo; commands alone: make figures FIGURES=--show
FIGURES ?=
figures: setup
	$(BIN)/python -m edgemap.benchmarks.figures $(FIGURES)

# The libraries that an install of the wheel brings, as CycloneDX, into sbom/; the tool and the install have environments of
# their own.
sbom:
	rm -rf .sbom sbom && mkdir sbom
	$(PYTHON) -m venv .sbom/tool && .sbom/tool/bin/python -m pip install -q cyclonedx-bom==7.5.0
	$(PYTHON) -m venv --without-pip .sbom/edgemap
	.sbom/tool/bin/python -m pip --python .sbom/edgemap/bin/python install -q -c constraints.txt dist/*.whl
	.sbom/tool/bin/cyclonedx-py environment --output-reproducible -o sbom/edgemap.cdx.json .sbom/edgemap/bin/python

# Known vulnerabilities of the pinned libraries: fails where one has any, and where the service cannot be reached.
# ADVISORIES is one of pip-audit's services; it has an environment of its own, since its libraries are none of edgemap's.
ADVISORIES ?= pypi
audit:
	test -x .audit/bin/pip-audit || { $(PYTHON) -m venv .audit && .audit/bin/python -m pip install -q pip-audit==2.10.1; }
	.audit/bin/pip-audit -r constraints.txt --no-deps --disable-pip --strict --vulnerability-service $(ADVISORIES)

# Kills, sensors that lie, 100,000 fuzzed steps with camera faults, a long day, an hour of rendered drive; one part alone: make reliability PARTS=fuzz; a tenth: SHARE=0.1
PARTS ?=
SHARE ?= 1
SEED ?= 0
reliability: setup
	PYTHONPATH=tests $(BIN)/python -m reliability $(PARTS) --seed $(SEED) --share $(SHARE)

# Real counterparts: Home Assistant (the last for Python 3.11) and other packages' detectors in environments of their own, skipped
# where one cannot be made; published weights with the AP50 known of them.
HOME_ASSISTANT := homeassistant==2024.3.3 home-assistant-frontend==20240307.0 paho-mqtt==1.6.1 Pillow==10.2.0 SQLAlchemy==2.0.27 \
	fnv-hash-fast==0.5.0 psutil-home-assistant==0.0.1 janus==1.0.0 josepy==1.14.0 mutagen==1.47.0 hassil==1.6.1 \
	home-assistant-intents==2024.3.12
integration: setup
	@scripts/system-packages mosquitto mosquitto-clients
	@test -e .home-assistant/installed || { $(PYTHON) -m venv .home-assistant && \
		.home-assistant/bin/python -m pip install -q $(HOME_ASSISTANT) && touch .home-assistant/installed; } || rm -rf .home-assistant
	EDGEMAP_INTEGRATION=1 $(BIN)/python -m pytest --timeout 900 tests/integration

# A release from its archives alone: two builds with one sum, sizes, the demo from the wheel in a clean environment; then
# the steps of deploy/Dockerfile. EXTRAS=--extras: each extra alone as well.
EXTRAS ?=
release-check: setup
	$(BIN)/python scripts/check_release.py $(EXTRAS)

# The paper's Tables 2 to 5 for homes unseen in training (rendered once, which takes its time), and its own beside
# them. Other data: python -m edgemap.benchmarks.paper_tables --data KIND:DIR ...
PAPER_SEEDS ?= 9100:9110
PAPER_OUT ?= runs/paper-tables
paper-tables: setup
	$(BIN)/python -m edgemap.benchmarks.paper_tables --seeds $(PAPER_SEEDS) -o $(PAPER_OUT)

# The moving picture of the README and the pictures of the docs, from today's page, the same on a busy machine; needs chromium.
demo: setup
	$(BIN)/python scripts/demo_picture.py

# Renders the demo drive again (runtime/inputs/demo/); some minutes.
demo-drive: setup
	$(BIN)/edgemap simulate --plain --seed 9160 --frames 600 --video -o runtime/inputs/demo

# Wheel and source archive of the version in api/__init__.py, checked; a tag publishes them (.github/workflows/release.yml).
release: setup
	rm -rf dist
	$(BIN)/python scripts/check_release.py --build dist
	$(BIN)/python -m twine check --strict dist/*
	@version=$$($(BIN)/python -c 'import edgemap; print(edgemap.__version__)'); \
	grep -q "^## $$version" CHANGELOG.md || { echo "CHANGELOG.md has no section for this version"; exit 1; }; \
	grep -qx "version: $$version" CITATION.cff || { echo "CITATION.cff has another version"; exit 1; }

clean:
	rm -rf $(VENV) .typing site build dist *.egg-info
