"""Tests of .ci/dependencies: python3 .ci/test_dependencies.py"""

import importlib.machinery
import importlib.util
import pathlib
import tempfile
import unittest

path = str(pathlib.Path(__file__).with_name("dependencies"))
loader = importlib.machinery.SourceFileLoader("dependencies", path)
dependencies = importlib.util.module_from_spec(importlib.util.spec_from_loader("dependencies", loader))
loader.exec_module(dependencies)

ADVISORY = """```toml
[advisory]
id = "RUSTSEC-2099-0001"
package = "example"

[versions]
patched = ["^0.9.11", ">= 1.2.3"]
unaffected = ["< 0.9.0"]
```

# It breaks
"""


class Licences(unittest.TestCase):
    def test_a_choice_is_enough_but_all_parts_must_be_allowed(self):
        for text in ["MIT", "MIT/Apache-2.0", "GPL-3.0 OR MIT", "(MIT OR GPL-3.0) AND ISC",
                     "Apache-2.0 WITH LLVM-exception OR GPL-2.0"]:
            self.assertTrue(dependencies.allowed(text), text)
        for text in ["", "GPL-3.0", "MIT AND GPL-3.0", "AGPL-3.0 OR GPL-3.0", "MIT MIT", "Apache-2.0 WITH nothing"]:
            self.assertFalse(dependencies.allowed(text), text)


class Advisories(unittest.TestCase):
    def test_versions_between_the_safe_ranges_are_found(self):
        with tempfile.TemporaryDirectory() as folder:
            database = pathlib.Path(folder)
            (database / "crates/example").mkdir(parents=True)
            (database / "crates/example/RUSTSEC-2099-0001.md").write_text(ADVISORY)

            def found(version):
                return list(dependencies.advisories_of(database, {"name": "example", "version": version}))

            for vulnerable in ["0.9.0", "0.9.10", "0.10.0", "1.2.2", "1.2.3-rc.1"]:
                self.assertEqual(len(found(vulnerable)), 1, vulnerable)
            for safe in ["0.8.9", "0.9.11", "0.9.12", "1.2.3", "2.0.0"]:
                self.assertEqual(found(safe), [], safe)


if __name__ == "__main__":
    unittest.main()
