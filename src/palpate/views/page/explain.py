"""What the page says about a run: which nodes run, what is left out and why (as `palpate plan`), its hard cases."""

from typing import Any

from palpate.engine.plan import Plan
from palpate.launch.load.effect_costs import effect_costs
from palpate.messages import Surface
from palpate.nodes.device.mouse import Pointer
from palpate.views.page.hard import for_page, force_limit, hard_cases


def explain_plan(planned: Plan) -> dict[str, Any]:
    """Plain data for the page.

    runs      name and class of each running node, with its divisor of the rate if it has one
    left_out  name of each other node, and the reason
    effects   name of each effect, whether it is computed, the rule that decided, and what it is
    """
    nodes = planned.graph.nodes
    running = [nodes[name] for name in planned.order if not issubclass(nodes[name].cls, Pointer)]
    return {
        "runs": [[spec.name, spec.use + (f", every {spec.every}" if spec.every > 1 else "")] for spec in running],
        "left_out": [list(each) for each in planned.skipped.items()],
        "effects": [[e.effect, e.on, e.rule, e.about] for e in effect_costs(planned) if not e.observed],
    }


def explain_run(planned: Plan, case: str | None) -> dict[str, Any]:
    """Plain data for the page that steers a run: its plan, the hard cases and the one that runs, and the largest force
    [N] on the hand."""
    return {
        "plan": explain_plan(planned),
        "hard": for_page(hard_cases(planned.graph, bodies_of(planned))),
        "case": case,
        "limit": force_limit(planned.graph),
    }


def bodies_of(planned: Plan) -> list[str]:
    """The running nodes that are bodies."""
    return [name for name in planned.order if Surface in planned.graph.nodes[name].streams.values()]
