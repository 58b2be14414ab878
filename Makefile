# Everything runs in .venv, which is made on first use. Needs Python 3.11+ and make, nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SCENES := golf_ball golf_ball_hole golf_ball_mesh cut_holes tower occluded_bumps bark statue_hole cut_statue holed_scans simple_patterns published_figures bunny_scan face_holes sea_vase bird_bath relighting real_relighting relit_teapot larger_photographs larger_materials larger_relightables photographed_head photographed_objects restoration geometry_textures weave_on_vase
SOURCES := $(shell find toolkit kernels render scenes -name '*.py' -not -path '*/__pycache__/*' | sort)
# A strict editable install maps single files: it is renewed when pyproject.toml or the list of files changes.
STAMP := $(VENV)/.installed-$(shell (echo $(SOURCES); cat pyproject.toml) | cksum | cut -d' ' -f1)

.PHONY: demo scenes test test-all fuzz lint bench clean docs install package

install: $(STAMP)

$(STAMP):
	@test -x $(BIN)/python || $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed; call make PYTHON=python3.12, say")'
	@test -x $(BIN)/python || { echo "making $(VENV) …"; $(PYTHON) -m venv $(VENV); }
	@echo "installing Intaglio and what it needs into $(VENV) (the first time this takes a few minutes) …"
	@rm -rf build $(VENV)/.installed-*
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test]'
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[points,raw,peers]' \
	  || echo "some packages for laser scans, raw photographs and comparisons can't be had here: tests that need them are skipped"
	@touch $@

demo: install
	@$(BIN)/python -m intaglio.scenes.golf_ball --output out
	@$(BIN)/python -m intaglio.scenes.statue_hole carved_hair --output out
	@echo "open out/golf_ball.html and out/carved_hair.html for pictures and figures, out/carved_hair_close.png for the hole close by"

scenes: install
	@set -e; for scene in $(SCENES); do $(BIN)/python -m intaglio.scenes.$$scene --output out; done

test: install
	$(BIN)/python -m pytest -n auto --dist worksteal -m 'not slow' -q

test-all: install
	$(BIN)/python -m pytest -n auto --dist worksteal -q

# Spoiled files for every reader, for so many seconds; the same seed gives the same files.
SECONDS ?= 300
SEED ?= 0
fuzz: install
	$(BIN)/python tests/fuzzing.py --seconds $(SECONDS) --seed $(SEED)

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: install
	@$(BIN)/python -m tests.benchmarks.reading
	@$(BIN)/python -m tests.benchmarks.relief
	@$(BIN)/python -m tests.benchmarks.holes
	@$(BIN)/python -m tests.benchmarks.photometric
	@$(BIN)/python -m tests.benchmarks.synthesis
	@$(BIN)/python -m tests.benchmarks.photographs
	@$(BIN)/python -m tests.benchmarks.geometry

docs: install
	@$(BIN)/python -c 'import furo, matplotlib, myst_parser, numpydoc, sphinx_click' 2>/dev/null \
	  || $(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[docs]'
	@rm -rf docs/reference/generated
	$(BIN)/sphinx-build -W --keep-going -b html -d out/doctrees docs out/docs
	@echo "open out/docs/index.html"

SMALL_JOB := import numpy as np, intaglio; hole = np.zeros((64, 64)); hole[24:36, 20:40] = 1; \
  wave = 0.5 + 0.3 * np.sin(np.arange(64) / 3) * np.ones((64, 1)); \
  intaglio.write_image(hole, 'hole.png'); intaglio.write_image(wave * (1 - hole), 'damaged.png')
# Wheel and sdist as a user gets them: the wheel in an environment of its own, away from the sources, does a small job.
package: install
	@rm -rf dist out/package
	@$(BIN)/python -m build --quiet --outdir dist .
	@$(PYTHON) -m venv out/package/venv
	@out/package/venv/bin/python -m pip install --quiet --disable-pip-version-check dist/*.whl
	@cd out/package && venv/bin/intaglio info && venv/bin/python -c "$(SMALL_JOB)" \
	  && venv/bin/intaglio restore damaged.png hole.png -o restored.png && test -s restored.png
	@echo "dist/ holds a wheel and an sdist that work"

clean:
	rm -rf build dist out $(VENV) .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
