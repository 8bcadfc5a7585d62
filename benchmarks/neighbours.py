"""Random pairs of organs that touch while a finger presses one of them: python benchmarks/neighbours.py [--pairs 200]

Prints a line for each fault, and the ten worst by overlap, energy, and change of the force (docs/equations/between.md).
"""

import argparse
import time

from palpate.studies.organ_pairs import Verdict, search


def line(verdict: Verdict) -> str:
    case = verdict.case
    upper, lower = (f"{b['use']} {b['surface']['surface']}" for b in (case.upper, case.lower))
    return (
        f"{case.number:5d} {upper:>18} {lower:>18} gap {1e3 * case.gap:4.2f} mm, "
        f"overlap {1e3 * verdict.overlap:.1e} mm, "
        f"generated {verdict.generated:.1e} J, change {verdict.change:.3f}, finger {verdict.finger:.3g} N, "
        f"organs {verdict.organs:.3g} N {', '.join(verdict.faults)}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="number of the first pair")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    begin, found = time.process_time(), []
    for verdict in search(given.pairs, given.seed, given.first):
        found.append(verdict)
        if verdict.faults:
            print(line(verdict), flush=True)
    touched = [each for each in found if each.organs > 0.0]
    faulty = sum(bool(each.faults) for each in found)
    print(f"{len(found)} pairs, {len(touched)} touch, {faulty} with faults, {time.process_time() - begin:.0f} s")
    for title, key in (("overlap", "overlap"), ("energy", "generated"), ("change", "change")):
        print(f"worst ten by {title}:")
        for each in sorted(touched, key=lambda verdict: -getattr(verdict, key))[:10]:
            print("  " + line(each))


if __name__ == "__main__":
    main()
