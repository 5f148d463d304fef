"""For all tests: numerics get one thread, and arithmetic that repeats; both must be set before torch is imported."""

import os

from deploy.plan import ENVIRONMENT

os.environ.update(ENVIRONMENT)
