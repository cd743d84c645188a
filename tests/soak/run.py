"""`make soak`: what takes too long for the tests, many times over, with everything that is random.

Every section is a module beside this file with ``TITLE``, ``add_options(parser)`` and
``run(arguments)``, which returns whether all went well. Sections can be named, with their options:
``make soak ARGS="inputs --seed 7"``; without a name all are done, with their defaults.
"""

import argparse
import importlib
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

SECTIONS = ("inputs", "kills", "tables")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.set_defaults(section=None)
    chosen = parser.add_subparsers(metavar="SECTION")
    modules = {name: importlib.import_module(f"tests.soak.{name}") for name in SECTIONS}
    for name, module in modules.items():
        section = chosen.add_parser(name, help=module.TITLE, description=module.TITLE)
        section.set_defaults(section=name)
        module.add_options(section)
    arguments = parser.parse_args()
    wanted = [arguments.section] if arguments.section else list(SECTIONS)
    failed = []
    for name in wanted:
        print(f"=== {name}: {modules[name].TITLE}", flush=True)
        began = time.perf_counter()
        given = arguments if arguments.section else parser.parse_args([name])
        if not modules[name].run(given):
            failed.append(name)
        print(f"=== {name}: {time.perf_counter() - began:.0f} s", flush=True)
    if failed:
        sys.exit(f"soak: {', '.join(failed)} failed")


if __name__ == "__main__":
    main()
