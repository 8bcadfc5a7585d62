"""Run the shipped experiments with simulated observers, and draw their answers:
python docs/pictures/experiment.py [folder]

experiment-stiffness.png  `palpate experiment kidney-stiffness --simulate`, two participants
experiment-page.png       a question on the page; needs Chromium
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from palpate.studies.psychophysics.analysis import analyse, save
from palpate.studies.psychophysics.opening import OF_EXPERIMENT, open_sitting
from palpate.studies.psychophysics.pictures import draw_answers
from palpate.views.page import serve

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
NAME = "kidney-stiffness"


def main(folder: Path) -> list[Path]:
    """Run, analyse, draw."""
    target = folder / "experiment-stiffness.png"
    with tempfile.TemporaryDirectory() as results:
        data = Path(results)
        for participant in ("01", "02"):
            opening = open_sitting(NAME, data, participant, None, [], True, lambda text: None, OF_EXPERIMENT)
            with opening as sitting:
                sitting.simulate(lambda trial: None)
        outcomes = analyse(data)
        save(outcomes, data)
        shutil.copyfile(draw_answers(outcomes, data)[0], target)
    return [target, *([page(folder / "experiment-page.png")] if CHROMIUM else [])]


def page(target: Path) -> Path:
    """An interval of the experiment, pressed with the mouse, and the question after it."""
    from PIL import Image
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as results, sync_playwright() as play:
        shots = [Path(results, name) for name in ("interval.png", "question.png")]
        browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--enable-unsafe-swiftshader"])
        window = browser.new_page(viewport={"width": 720, "height": 520})
        with open_sitting(NAME, Path(results), None, None, [], True, lambda text: None) as sitting:
            server = serve(sitting.page())
            window.goto(server.address)
            for _ in range(2):  # the instructions of the experiment, those of the block
                window.wait_for_selector("#panel button")
                window.keyboard.press("Enter")
                window.wait_for_timeout(500)
            for interval in (1, 2):
                window.wait_for_selector("body.interval", timeout=60_000)
                window.mouse.move(370, 240)
                window.mouse.down()
                window.wait_for_timeout(1500)
                if interval == 1:
                    window.screenshot(path=shots[0])
                window.mouse.up()
                window.wait_for_selector("body:not(.interval)")
            window.wait_for_selector("#panel kbd")
            window.screenshot(path=shots[1])
            browser.close()
            server.close()
        images = [Image.open(shot) for shot in shots]
        both = Image.new("RGB", (sum(image.width for image in images) + 8, images[0].height), "#dedbd6")
        both.paste(images[0], (0, 0))
        both.paste(images[1], (images[0].width + 8, 0))
        both.save(target)
    return target


if __name__ == "__main__":
    from target import folder

    print(*main(folder(__doc__)), sep="\n")
