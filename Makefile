# Everything runs in .venv, built from pinned constraints. No target but browser and slurm needs more than Python 3.11 and make.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
# One thread a process for numerics, and arithmetic that does not depend on memory alignment.
TEST_ENVIRONMENT := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 MKL_CBWR=AUTO,STRICT

PACKAGES := adapters analysis common deploy railctl services tools
# All that runs and evaluations need, so that no first start takes a minute longer than others.
COMPILERS := railctl.common.policy.compile railctl.services.learner.compile railctl.services.evaluator.references.compile

.PHONY: install demo check test docs parity browser notebook sb3 slurm soak chaos fuzz results clean

install: $(VENV)/installed

$(VENV)/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --constraint constraints.txt torch==2.13.0
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[dev]'
	$(BIN)/python -m compileall -q $(PACKAGES)
	printf '%s\n' $(COMPILERS) | xargs -n 1 -P 2 $(BIN)/python -m > /dev/null
	touch $@

# Learns more often than the study does, so that the curve rises within 300 episodes.
demo: install
	$(BIN)/railctl up --algorithm dddqn --level easy --actors easy=2 --episodes 300 --seed 1 --name demo \
		--set evaluation.every_episodes=50 --set dqn.learn_every_steps=8 --set fragment_steps=8

check: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

test: check
	$(TEST_ENVIRONMENT) $(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m 'not slow and not parity and not browser and not notebook and not sb3 and not slurm and not documents'

# Executes every command that README and documents show, which takes a quarter of an hour.
docs: install
	$(TEST_ENVIRONMENT) $(BIN)/pytest -m documents tests/documents

parity: install
	$(TEST_ENVIRONMENT) $(BIN)/pytest -m parity tests/parity

# Needs Chromium (Debian: apt-get install chromium chromium-driver); leaves screenshots in .browser.
browser: install
	$(TEST_ENVIRONMENT) $(BIN)/pytest -m browser --basetemp .browser tests/unit/analysis/report tests/system/test_watch_page.py

# Executes a copy of the notebook, in a folder of its own, as somebody does who has just made a clone: two minutes or so.
notebook: install
	$(TEST_ENVIRONMENT) $(BIN)/pytest -m notebook tests/unit/railctl

# Adds stable-baselines3 and SuperSuit to .venv; trains for a minute or two.
sb3: install
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[sb3]'
	$(TEST_ENVIRONMENT) $(BIN)/pytest -m sb3 tests/unit/adapters
	$(TEST_ENVIRONMENT) $(BIN)/python examples/train_sb3.py

# Needs Slurm (Debian: apt-get install slurm-wlm munge), which it starts for itself with two nodes on this machine.
slurm: install
	$(TEST_ENVIRONMENT) $(BIN)/pytest -m slurm tests/slurm

soak: install
	$(TEST_ENVIRONMENT) $(BIN)/pytest -m slow

# Random faults upon real runs, which must come to the curve of an undisturbed one; the same seed draws the same faults.
chaos: install
	$(TEST_ENVIRONMENT) $(BIN)/python tests/chaos/campaign.py --seed $(or $(SEED),1) --faults $(or $(FAULTS),50)

# Damaged and hostile messages, files and run files, so many cases of each property: a million in all, in about an hour.
fuzz: install
	$(TEST_ENVIRONMENT) RAILCTL_FUZZ_CASES=$(or $(CASES),16000) $(BIN)/pytest -n 2 --maxschedchunk 1 -m fuzz --hypothesis-show-statistics

# Makes tables, figures and pages anew from the results that are kept with the project.
results: install
	for file in results/*/results.json.xz; do \
		$(BIN)/python -m railctl.analysis.report --results $$file --output $$(dirname $$file) > /dev/null || exit 1; \
	done

clean:
	rm -rf $(VENV)
