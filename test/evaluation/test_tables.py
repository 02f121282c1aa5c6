import pytest
from scenes import scene

from people_fusion.evaluation.clear_mot import ClearMot
from people_fusion.evaluation.consistency import Consistency
from people_fusion.evaluation.evaluate import Scores, evaluate
from people_fusion.evaluation.hota import Hota
from people_fusion.evaluation.identity import Identity
from people_fusion.evaluation.tables import Table, count_table, score_table

# Poschmann's T1-L1, table 7.1, on 1602 annotations.
T1_L1 = Scores(
    ClearMot(267, 1602, 1081, 521, 284, 21, 15, 20, 1081 * 0.060), Identity(5, 4, 6), Hota(), Consistency(2, 4, 10.0, 3)
)


def test_scores_stand_in_the_columns_of_table_7_1():
    assert score_table({"T1-L1": T1_L1, "nothing": Scores()}).as_text().splitlines() == [
        "          MOTP    MOTA  misses  false pos.  mismatches    IDF1  HOTA  NEES",
        "-------  -----  ------  ------  ----------  ----------  ------  ----  ----",
        "T1-L1    60 mm  48.4 %  32.5 %      17.7 %       1.3 %  50.0 %     –  2.50",
        "nothing      –       –       –           –           –       –     –     –",
    ]


def test_markdown_is_a_table_whatever_the_names_hold():
    lines = Table(("name", "value"), (("a|b", "1"), ("long name", "12345"))).as_markdown().splitlines()
    assert lines == [
        "| name      | value |",
        "| --------- | ----: |",
        "| a\\|b      |     1 |",
        "| long name | 12345 |",
    ]


def test_false_positives_that_were_not_counted_are_not_shown_as_none():
    scores = evaluate(*scene([({1: (0, 0)}, {11: (0, 0), 12: (5, 5)})]), only_annotated=True).scores
    assert score_table({"": scores}).rows[0][4] == "–"
    assert ("false positives", "not counted") in count_table(scores).rows


@pytest.mark.parametrize("scores", [T1_L1, Scores()])
def test_counts_have_a_word_for_everything(scores):
    assert all(name and value for name, value in count_table(scores).rows)
