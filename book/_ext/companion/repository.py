"""Launch and source buttons, where BOOK_REPOSITORY=https://github.com/owner/name is set."""

import os


def fill_in(app, config):
    url = os.environ.get("BOOK_REPOSITORY", "").rstrip("/")
    if not url:
        return
    config.html_theme_options.update(
        repository_url=url,
        repository_branch=os.environ.get("BOOK_BRANCH", "main"),
        path_to_docs="",
        use_repository_button=True,
        use_issues_button=True,
        launch_buttons={"binderhub_url": "https://mybinder.org", "notebook_interface": "jupyterlab"},
    )


def source_link(path, line=None):
    """Address of a file of this repository, or None where the repository is not known."""
    url = os.environ.get("BOOK_REPOSITORY", "").rstrip("/")
    if not url:
        return None
    return f"{url}/blob/{os.environ.get('BOOK_BRANCH', 'main')}/{path}" + (f"#L{line}" if line else "")


def setup(app):
    app.connect("config-inited", fill_in)
