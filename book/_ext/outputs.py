"""Run notebooks in place and store what they show, without anything that changes from run to run.

python book/_ext/outputs.py book/01_mdp.ipynb ...      also writes book/data/run_times.yml
"""

import sys
import time
from importlib import metadata
from pathlib import Path

import nbformat
import yaml
from nbclient import NotebookClient

KERNEL = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
PACKAGES = ("numpy", "scipy", "numba", "matplotlib", "gymnasium", "jupyter-book", "sphinx", "myst-nb")
WIDGET = "application/vnd.jupyter.widget-view+json"  # points into a kernel that is gone


def settle(notebook):
    """Drop times, widget views and the like; number the cells."""
    notebook.metadata = nbformat.from_dict(KERNEL)
    for i, cell in enumerate(notebook.cells, start=1):
        cell["id"] = f"c{i:03d}"
        cell.metadata.pop("execution", None)
        for output in cell.get("outputs", []):
            output.get("data", {}).pop(WIDGET, None)
    return notebook


def run(path):
    """Run one notebook where it lies; seconds that it took."""
    notebook = nbformat.read(path, as_version=4)
    start = time.perf_counter()
    where = {"metadata": {"path": path.parent}}
    NotebookClient(notebook, timeout=600, kernel_name="python3", coalesce_streams=True, resources=where).execute()
    seconds = time.perf_counter() - start
    nbformat.write(settle(notebook), path)
    return round(seconds)


def key(path):
    """A notebook's name below book, without its ending."""
    return path.resolve().relative_to(Path(__file__).parents[1]).with_suffix("").as_posix()


def main(paths):
    store = Path(__file__).parents[1] / "data" / "run_times.yml"
    store.parent.mkdir(exist_ok=True)
    record = (yaml.safe_load(store.read_text()) if store.exists() else None) or {"seconds": {}}
    record["versions"] = {name: metadata.version(name) for name in PACKAGES}
    for path in paths:
        record["seconds"][key(path)] = run(path)
        store.write_text(yaml.safe_dump(record))
        print(f"{path}: {record['seconds'][key(path)]} s", flush=True)


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]])
