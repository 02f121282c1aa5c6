from html.parser import HTMLParser

import numpy as np
from scenes import random_scene

from people_fusion.evaluation.evaluate import evaluate
from people_fusion.evaluation.report import report, run_report, write_report

VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Checks that tags are closed in order, and collects text and whatever the page loads."""

    def __init__(self, html):
        super().__init__()
        self.open, self.loads, self.texts, self.tags = [], [], [], []
        self.feed(html)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.loads.extend(value for name, value in attrs if name in ("src", "href"))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def page(**words):
    truth, estimates = random_scene(np.random.default_rng(3), 15, 3)
    evaluation = evaluate(truth, estimates)
    return run_report(words.pop("title", "museum"), truth, estimates, evaluation, **words), evaluation


def test_report_loads_nothing_from_elsewhere():
    html, _ = page()
    parsed = Page(html)
    assert len(parsed.loads) == 6
    assert all(source.startswith("data:image/png;base64,") for source in parsed.loads)
    assert "script" not in parsed.tags and "link" not in parsed.tags
    assert "http:" not in html and "https:" not in html and "url(" not in html


def test_report_escapes_every_word_that_is_given():
    evil = "<script>alert('&\"')</script>"
    html, _ = page(title=evil, notes=[evil], counters={evil: evil}, settings={evil: {evil: evil}})
    parsed = Page(html)
    assert "script" not in parsed.tags
    assert parsed.texts.count(evil) == 6  # title, heading, note, two counter cells, value
    assert f"{evil}/{evil}" in parsed.texts


def test_report_shows_scores_settings_and_counters():
    html, evaluation = page(settings={"tracker": {"type": "kalman"}}, counters={"transform too late": 3})
    texts = Page(html).texts
    assert f"{100 * evaluation.to_dict()['mota']:.1f} %" in texts
    assert {"tracker/type", "kalman", "transform too late", "3"} <= set(texts)


def test_same_run_gives_same_report():
    assert page()[0] == page()[0]


def test_report_of_several_runs_compares_them(tmp_path):
    _, evaluation = page()
    html = report("presets", {"default": evaluation.scores, "volkhardt": evaluation.scores}, [])
    write_report(tmp_path / "new" / "report.html", html)
    texts = Page((tmp_path / "new" / "report.html").read_text(encoding="utf-8")).texts
    assert {"presets", "default", "volkhardt", "MOTA"} <= set(texts)
