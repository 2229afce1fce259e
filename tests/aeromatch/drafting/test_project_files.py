"""Files of a drafted project that their author, or an accident, has damaged."""

import pytest

from aeromatch.drafting.project_files import ProjectFiles
from flightmech.errors import ParseError

DRAFTS = {
    "aeromatch.toml": 'title = "a"\n',
    "cases/phugoid.toml": 'title = "a"\n',
    "manoeuvres.csv": "record,kind,control,start,end\na,doublet,elevator,1,2\n",
}
NEW = {"toml": 'title = "b"\n', "csv": "record,kind,control,start,end\nb,pulse,rudder,1,2\n"}


def _write(folder, name, text):
    with ProjectFiles(folder) as files:
        files.write(name, text)


@pytest.mark.parametrize("name", ["aeromatch.toml", "cases/phugoid.toml"])
def test_a_faulty_file_of_the_author_is_named_with_its_line(tmp_path, name):
    _write(tmp_path, name, DRAFTS[name])
    faulty = DRAFTS[name] + "cases = [\n"
    (tmp_path / name).write_text(faulty)
    with pytest.raises(ParseError, match=name):
        _write(tmp_path, name, NEW["toml"])
    assert (tmp_path / name).read_text() == faulty


@pytest.mark.parametrize("name", DRAFTS)
def test_a_damaged_last_draft_is_named_with_the_remedy(tmp_path, name):
    _write(tmp_path, name, DRAFTS[name])
    (tmp_path / name).write_text(DRAFTS[name] + "\n")
    draft = tmp_path / ".draft" / name.rpartition("/")[2]
    draft.write_text("x = [")
    new = NEW[name.rpartition(".")[2]]
    with pytest.raises(ParseError, match="the file removed"):
        _write(tmp_path, name, new)
    draft.unlink()
    _write(tmp_path, name, new)
    assert DRAFTS[name].strip() in (tmp_path / name).read_text()
