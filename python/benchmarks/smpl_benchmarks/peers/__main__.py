"""`python -m smpl.bench [SECTION]...`: print all benchmarks, or some."""

from __future__ import annotations

import argparse
import platform
from functools import partial

from smpl_benchmarks.peers import (
    advection,
    batch,
    decisions,
    environments,
    episodes,
    exports,
    fit,
    kernel,
    kernels,
    mab,
    networks,
    pensim,
    ppo,
    precision,
    reactor,
    robertson,
    steps,
    stiff,
)

SECTIONS = {
    "steps": steps.main,
    "environments": environments.main,
    "episodes": episodes.main,
    "reactor": reactor.main,
    "batch": batch.main,
    "precision": precision.main,
    "stiff": stiff.main,
    "kernels": kernels.main,
    "kernel": kernel.main,
    "advection": advection.main,
    "robertson": robertson.main,
    "network": networks.main,
    "pensim": pensim.main,
    "mab": mab.main,
    "exports": exports.main,
    "decisions": decisions.main,
    "fit": fit.main,
    "ppo": ppo.main,
}


def main() -> None:
    """Run the sections that were asked for."""
    parser = argparse.ArgumentParser(prog="python -m smpl.bench", description="Benchmarks against peers.")
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"some of {', '.join(SECTIONS)}; all by default")
    parser.add_argument("--repeats", type=int, default=5, help="runs whose median is taken")
    parser.add_argument("--file", metavar="FILE.net", help="reaction network of the section `network`")
    arguments = parser.parse_args()
    unknown = [name for name in arguments.sections if name not in SECTIONS]
    if unknown:
        parser.error(f"no section {', '.join(unknown)}; there are: {', '.join(SECTIONS)}")
    print(f"{platform.machine()}, Python {platform.python_version()}; processor time of one thread, medians")
    sections = SECTIONS | {"network": partial(networks.main, path=arguments.file)}
    for name in arguments.sections or sections:
        sections[name](arguments.repeats)


if __name__ == "__main__":
    main()
