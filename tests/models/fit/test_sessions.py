"""Reading sessions: units, separators, and every kind of bad input by row and column."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pytest import approx

from palpate.models.fit.sessions import SessionError, check_stiffness, read_sessions

HEAD = "subject,session,depth [mm],force [N]"


def write(path, *lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def file(tmp_path):
    return tmp_path / "sessions.csv"


def test_rows_become_arrays_in_si_units(file):
    write(file, HEAD, "a,1,0,0", "a,1,0.5,0.1", "b,1,0,0.01", "", "# a remark", "b,1,0.5,0.2")
    (a, b), ignored = read_sessions(file)
    assert (a.name, b.name, ignored) == ("a", "b", [])
    assert a.depth == approx([0, 0.5e-3]) and b.force == approx([0.01, 0.2])
    assert b.rows.tolist() == [4, 7]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_order_of_columns_separator_units_and_extra_columns_are_free(file, separator):
    lines = ["Force (mN),who, DEPTH [m] ,Session,subject", "100,x,0.001,s1,a", "300,y,0.002,s1,a"]
    write(file, *(line.replace(",", separator) for line in lines))
    (a,), ignored = read_sessions(file)
    assert a.force == approx([0.1, 0.3]) and a.depth == approx([1e-3, 2e-3]) and ignored == ["who"]


def test_a_byte_order_mark_and_windows_lines_are_read(file):
    file.write_bytes(("\ufeff" + HEAD + "\r\na,1,1,0.2\r\n").encode())
    assert read_sessions(file)[0][0].force == approx([0.2])


def test_deeper_rows_are_left_out_where_a_limit_is_given(file):
    write(file, HEAD, "a,1,4.5,1", "a,1,5,1.1", "a,1,5.5,1.2")
    assert read_sessions(file, 5e-3)[0][0].depth == approx([4.5e-3, 5e-3])
    with pytest.raises(SessionError, match="no row is left up to the depth limit of 1 mm"):
        read_sessions(file, 1e-3)


@pytest.mark.parametrize(
    ("row", "text"),
    [
        (
            "a,1,1,-0.1",
            "row 3, column 'force': found -0.1, expected a force that is not negative, except for noise of at most"
            " 5 % of the subject's largest one",
        ),
        ("a,1,-1,0.1", "row 3, column 'depth': found -1, expected a depth that is not negative"),
        ("a,1,1,nan", "row 3, column 'force': found 'nan', expected a finite number"),
        ("a,1,inf,0", "row 3, column 'depth': found 'inf', expected a finite number"),
        ("a,1,1,", "row 3, column 'force': empty, expected a number"),
        ("a,1,1", "row 3, column 'force': empty, expected a number"),
        ("a,1,1500,1", "row 3, column 'depth': found 1500, which cannot be a depth; is the unit in the header right?"),
        (
            "a,1,1,1e300",
            "row 3, column 'force': found 1e300, which cannot be a force; is the unit in the header right?",
        ),
        ("a,1,1,much", "row 3, column 'force': found 'much', expected a number with a decimal point"),
        (",1,1,0.1", "row 3, column 'subject': empty, expected a label"),
        ("a, ,1,0.1", "row 3, column 'session': empty, expected a label"),
    ],
)
def test_a_bad_cell_is_named_by_row_and_column(file, row, text):
    write(file, HEAD, "a,1,0,0", row)
    with pytest.raises(SessionError) as error:
        read_sessions(file)
    assert str(error.value) == f"{file}, {text}"


def test_all_bad_cells_are_reported_at_once_up_to_a_limit(file):
    write(file, HEAD, *(f"a,1,{i},-1" for i in range(30)))
    with pytest.raises(SessionError) as error:
        read_sessions(file)
    lines = str(error.value).split("\n")
    assert len(lines) == 21 and lines[-1] == "... and 10 more"


@pytest.mark.parametrize(
    ("head", "text"),
    [
        ("subject,session,depth,force [N]", r"column 'depth': no unit; write 'depth \[UNIT\]', with mm"),
        ("subject,session,depth [s],force [N]", "column 'depth .s.': unit 's' is that of a time; expected a length"),
        ("subject,session,depth [mm],force", r"column 'force': no unit; write 'force \[UNIT\]'"),
        ("subject,session,depth [mm]", "no column 'force'; found 'subject', 'session', 'depth"),
        ("session,depth [mm],force [N]", "no column 'subject'"),
        ("subject,session,depth [mm],depth [mm],force [N]", "column 'depth' twice"),
    ],
)
def test_a_bad_header_is_named_by_column(file, head, text):
    write(file, head, "a,1,1,1,1")
    with pytest.raises(SessionError, match=text):
        read_sessions(file)


@pytest.mark.parametrize(
    ("content", "text"),
    [(b"", "empty; expected the columns"), (b"\xff\xfe\x00", "not a text file"), (HEAD.encode(), "no rows after")],
)
def test_files_without_rows_are_refused(file, content, text):
    file.write_bytes(content)
    with pytest.raises(SessionError, match=text):
        read_sessions(file)
    with pytest.raises(SessionError, match="cannot be read: No such file"):
        read_sessions(file.with_name("nix.csv"))


@given(st.binary(max_size=200) | st.text(alphabet="0123456789.,;-+eE\t\n\"'[]mNa# ", max_size=200).map(str.encode))
@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_bytes_are_read_or_refused(file, content):
    for head in (b"", HEAD.encode() + b"\n"):
        file.write_bytes(head + content)
        try:
            for subject in read_sessions(file)[0]:
                subject.grid()
        except SessionError:
            pass


def grid_of(file, *rows):
    write(file, HEAD, *rows)
    return read_sessions(file)[0][0].grid()


def test_sessions_at_the_same_depths_make_a_grid_in_any_order(file):
    depths, forces = grid_of(file, "a,s2,1,3", "a,s1,0,0", "a,s2,0,2", "a,s1,1,1")
    assert depths == approx([0, 1e-3])
    np.testing.assert_array_equal(forces, [[2, 3], [0, 1]])


def test_unequal_depths_are_named_by_session_and_row(file):
    rows = [f"a,{s},{d},{d}" for s in (1, 2, 3) for d in (0, 1, 2)]
    with pytest.raises(SessionError, match="after row 9, column 'depth': session '3' of subject 'a' lacks 2 mm"):
        grid_of(file, *rows[:-1])
    with pytest.raises(SessionError, match="row 11, column 'depth': found 3 mm in session '3' of subject 'a'"):
        grid_of(file, *rows, "a,3,3,3")
    with pytest.raises(SessionError, match=r"row 11, column 'depth': session '1' .* has 2 mm twice, first in row 4"):
        grid_of(file, *rows, "a,1,2,3")


@pytest.mark.parametrize(
    ("row", "text"),
    [
        ("a,1,1,0,5", "row 3: 5 cells, the header has 4; decimal commas? Write numbers with a point"),
        ("a,1,0,5,0,71", "row 3: 6 cells, the header has 4; decimal commas?"),
        ("a,1,1.5,0.7,seen twice", "row 3: 5 cells, the header has 4; expected as many"),
    ],
)
def test_a_row_of_more_cells_than_the_header_is_refused(file, row, text):
    write(file, HEAD, "a,1,0,0", row)
    with pytest.raises(SessionError) as error:
        read_sessions(file)
    assert str(error.value).startswith(f"{file}, {text}")


def test_noise_about_zero_is_read_unchanged(file):
    write(file, HEAD, "a,1,0,-0.012", "a,1,1,0.2", "a,1,2,0.7", "b,1,0,-0.012", "b,1,1,0.1", "b,1,2,0.2")
    with pytest.raises(SessionError) as error:
        read_sessions(file)
    assert str(error.value).startswith(f"{file}, row 5, column 'force': found -0.012, expected")  # 6 % of 0.2 N
    write(file, HEAD, "a,1,0,-0.012", "a,1,1,0.2", "a,1,2,0.7")
    assert read_sessions(file)[0][0].force == approx([-0.012, 0.2, 0.7])


@pytest.mark.parametrize(
    ("head", "row", "cure"),
    [
        (
            "subject,session,depth [mm],force [mN]",
            "a,1,5,2.7",
            "0.54 N/m; .* 'force .N.' or 'depth .(µ|μ|u)m.' would fit",
        ),
        ("subject,session,depth [mm],force [N]", "a,1,5,2700", "5.4e.05 N/m; .* 'force .mN.' or 'depth .m.' would fit"),
        ("subject,session,depth [mm],force [N]", "a,1,0.005,2.7", "5.4e.05 N/m"),
    ],
)
def test_a_stiffness_that_no_tissue_has_questions_the_units(file, head, row, cure):
    write(file, head, "a,1,0,0", row)
    subjects, _ = read_sessions(file)
    with pytest.raises(SessionError, match=cure):
        check_stiffness(subjects)


@pytest.mark.parametrize("stiffness", [20.0, 546.0, 3e4])
def test_stiffnesses_of_soft_tissue_are_not_questioned(file, stiffness):
    write(file, HEAD, "a,1,0,0", f"a,1,2,{stiffness * 2e-3}")
    check_stiffness(read_sessions(file)[0])
