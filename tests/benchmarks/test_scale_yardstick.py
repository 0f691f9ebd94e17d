"""The yardstick of scale on works of the test's own."""

from benchmarks import scale


def test_each_cost_is_said_as_soon_as_it_is_measured(monkeypatch, capsys):
    said = []

    def works(_folder, size):
        said.append(capsys.readouterr().err)
        yield "work", lambda: None

    monkeypatch.setattr(scale, "WORKS", {"shots": works, "campaigns": works, "candidates": works})
    report = scale.measure(shots=1000, campaigns=100, candidates=1000, picture="", old="")
    assert [row[:2] for row in report.tables[0].rows] == [("work", 100), ("work", 1000)]
    begins = [text.split(":")[0] for text in said]
    assert begins == ["", "work, 100", "work, 1000", "work, 100"]
