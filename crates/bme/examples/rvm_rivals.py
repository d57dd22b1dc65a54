"""Sinc and Friedman 1 data for the example rvm_bench, and what sklearn-rvm and fastrvm make of them.

    pip install numpy scikit-learn sklearn-rvm fastrvm
    python rvm_rivals.py FOLDER

writes FOLDER/TASK/{x,y}_{train,test}.npy (test targets are noise-free) and prints, for each package and task, seconds of one
fit on one thread, the least of three, relevance vectors and the root mean square error on the test inputs.
"""

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import sys
import time
from pathlib import Path

import numpy as np

N_TEST = 1000


def sinc(x):
    """sin(x)/x."""
    return np.sinc(x[:, 0] / np.pi)


def friedman(x):
    """Friedman's first problem: of ten coordinates five matter."""
    return 10 * np.sin(np.pi * x[:, 0] * x[:, 1]) + 20 * (x[:, 2] - 0.5) ** 2 + 10 * x[:, 3] + 5 * x[:, 4]


# Truth, bounds of the coordinates and their number, noise, inverse width g of the kernel exp(-g |x - x'|^2).
PROBLEMS = {"sinc": (sinc, (-10, 10), 1, 0.1, 0.25), "friedman": (friedman, (0, 1), 10, 1.0, 0.3)}
SIZES = (500, 1000)


def make(folder, problem, n):
    """The four tables of a task, from its folder where they are there already."""
    folder = folder / f"{problem}_{n}"
    parts = ("x_train", "y_train", "x_test", "y_test")
    if not all((folder / f"{part}.npy").is_file() for part in parts):
        truth, bounds, dim, noise, _ = PROBLEMS[problem]
        rng = np.random.default_rng(0)
        x, x_test = (rng.uniform(*bounds, (count, dim)) for count in (n, N_TEST))
        tables = (x, truth(x) + rng.normal(0, noise, n), x_test, truth(x_test))
        folder.mkdir(parents=True, exist_ok=True)
        for part, table in zip(parts, tables):
            np.save(folder / f"{part}.npy", table)
    return [np.load(folder / f"{part}.npy") for part in parts]


def with_sklearn_rvm(x, y, inverse_width):
    from sklearn_rvm import EMRVR

    # `gamma` is g of the kernel.
    model = EMRVR(kernel="rbf", gamma=inverse_width)
    model.fit(x, y)
    return len(model.relevance_vectors_), model.predict


def with_fastrvm(x, y, inverse_width):
    from fastrvm import RVR

    model = RVR(kernel="rbf", gamma=inverse_width)
    model.fit(x, y)
    return len(model.relevance_vectors_), model.predict


def main():
    if len(sys.argv) != 2:
        sys.exit("usage: rvm_rivals.py FOLDER")
    folder = Path(sys.argv[1])
    print(f"{'package':<12} {'task':<14} {'seconds':>9} {'vectors':>8} {'test error':>11}")
    for problem, n in ((problem, n) for problem in PROBLEMS for n in SIZES):
        x, y, x_test, y_test = make(folder, problem, n)
        inverse_width = PROBLEMS[problem][-1]
        for package, fit in (("sklearn-rvm", with_sklearn_rvm), ("fastrvm", with_fastrvm)):
            best = None
            for _ in range(3):
                start = time.perf_counter()
                vectors, predict = fit(x, y, inverse_width)
                seconds = time.perf_counter() - start
                best = seconds if best is None else min(best, seconds)
            error = np.sqrt(np.mean((np.ravel(predict(x_test)) - y_test) ** 2))
            print(f"{package:<12} {f'{problem}_{n}':<14} {best:>9.4f} {vectors:>8} {error:>11.4f}", flush=True)


main()
