"""The rows of an unpacked folder's table of pan and tilt."""

from array import array

from groundstation.conversion.session_folder_writer import SessionFolderWriter, WrittenCounts


def test_units_share_a_row_where_their_stamps_are_the_same_and_leave_cells_empty_elsewhere() -> None:
    folder = SessionFolderWriter.__new__(SessionFolderWriter)
    folder.done = WrittenCounts()
    folder._readings = {
        "left": array("d", [0.2, 3.0, 4.0, 0.1, 1.0, 2.0, 0.2, 5.0, 6.0]),
        "right": array("d", [0.1, 7.0, 8.0]),
    }
    assert list(folder._reading_rows()) == [["0.1", "1.0", "2.0", "7.0", "8.0"], ["0.2", "5.0", "6.0", "", ""]]
    assert folder.done.out_of_order == 1
