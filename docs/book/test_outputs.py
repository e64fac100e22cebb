"""Outputs in pages: which lines are found again, which numbers count as the same."""

import unittest

from outputs import MARK, ROOT, blocks, differences, excerpt, is_close

PAGE = """Text.

<!-- run -->
```bash
whorl a
```

```
a: 1.85 times
  x   2
...
```

```bash
not run
```

<!-- run -->
```bash
cp -r a b
```
Text.
"""

PRINTED = ["a: 1.91 times", "", "  x       2.5", "  y       3", ""]


class Outputs(unittest.TestCase):
    def test_marked_blocks_are_found_with_their_outputs(self):
        self.assertEqual(blocks(PAGE), [("whorl a", 8, ["a: 1.85 times", "  x   2", "..."]), ("cp -r a b", None, [])])

    def test_lines_get_their_new_numbers_and_gaps_their_dots(self):
        lines, lost = excerpt(["a: 1.85 times", "  x   2", "..."], PRINTED)
        self.assertEqual((lines, lost), (["a: 1.91 times", "", "  x       2.5", "..."], None))
        lines, lost = excerpt(["  y  7"], PRINTED)
        self.assertEqual((lines, lost), (["...", "  y       3"], None))

    def test_a_line_with_a_few_other_words_is_the_same_line(self):
        shown = ["Correlated: gyro_z over about 4.2 s, of vector_1b over about 4 s, and of 3 other channels."]
        printed = ["First.", "Correlated: gyro_z over about 4.1 s, of vector_1a over about 5 s, and of 2 other channels."]
        lines, lost = excerpt(shown, printed)
        self.assertEqual((lines, lost), (["...", printed[1]], None))
        self.assertEqual(len(differences(shown, lines)), 1)

    def test_a_line_that_is_gone_is_named(self):
        lines, lost = excerpt(["  of_excess 100 lambda", "a: 1 times"], PRINTED)
        self.assertEqual((lines[0], lost), ("a: 1.91 times", "  of_excess 100 lambda"))

    def test_numbers_are_close_within_two_per_cent_and_their_last_digit(self):
        for old, new, close in [("1.85", "1.86", True), ("1.85", "1.91", False), ("12160.3", "12200", True), ("100", "2", False), ("-1.2", "-1.3", True), ("0", "1", True), ("0.0", "0.3", False), ("2.512e-1", "2.52e-1", True), ("7.02e-4", "9.1e-4", False)]:
            self.assertEqual(is_close(old, new), close, (old, new))

    def test_every_block_of_the_readme_is_run_by_something_that_there_is(self):
        lines = (ROOT / "README.md").read_text().split("\n")
        marks = [lines[k - 1] for k, line in enumerate(lines) if line in ("```sh", "```bash", "```python")]
        self.assertGreater(len(marks), 4)
        for mark in marks:
            if mark != MARK:
                self.assertRegex(mark, r"^<!-- run by: (\S+) -->$")
                self.assertTrue((ROOT / mark.split()[3]).exists(), mark)

    def test_differences_name_both_lines(self):
        self.assertEqual(differences(["x 1.85", "..."], ["x    1.86"]), [])
        self.assertEqual(differences(["x 100 %"], ["x 2 %"]), ["  page:  x 100 %\n  now:   x 2 %"])


if __name__ == "__main__":
    unittest.main()
