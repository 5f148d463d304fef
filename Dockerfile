# railctl with all that it needs, its compiled code included: docker build --tag railctl .
FROM python:3.11-slim

# The oldest processor that the compiled code is for: one of the last ten years. x86-64 takes any, and is slower.
ARG CPU=x86-64-v3

WORKDIR /opt/railctl
COPY constraints.txt ./
RUN pip install --no-cache-dir --constraint constraints.txt torch==2.13.0
COPY pyproject.toml README.md LICENSE ./
COPY adapters adapters
COPY analysis analysis
COPY common common
COPY deploy deploy
COPY services services
COPY tools tools
RUN pip install --no-cache-dir --constraint constraints.txt --editable . \
    && python -m compileall -q adapters analysis common deploy services tools

# Its user's alone, but for the code: runs, and what is compiled beside what the image has, for other processors.
ENV NUMBA_CPU_NAME=$CPU NUMBA_CPU_FEATURES="" NUMBA_CACHE_DIR=/var/cache/railctl
ENV RAILCTL_RUNS=/runs MPLCONFIGDIR=/tmp/matplotlib PYTHONUNBUFFERED=1
RUN useradd --uid 10001 --create-home railctl \
    && install --directory --owner railctl --group railctl /runs /var/cache/railctl
USER railctl
RUN python -m railctl.common.policy.compile > /dev/null \
    && python -m railctl.services.learner.compile > /dev/null \
    && python -m railctl.services.evaluator.references.compile > /dev/null

VOLUME /runs
ENTRYPOINT ["railctl"]
