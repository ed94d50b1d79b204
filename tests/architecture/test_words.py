"""The texts of the tree follow docs/style.md, and the check finds planted violations."""

from __future__ import annotations

import pytest
from tools import check_words
from tools.check_words import Text


def found_in(texts: object) -> list[str]:
    return [line for text in list(texts) for line in check_words.findings(text)]  # type: ignore[call-overload]


def test_no_text_is_rejected() -> None:
    assert found_in(check_words.texts(check_words.ROOT)) == []


@pytest.mark.parametrize("words", ["Nobody waits", "a frame that is no robot", "whoever writes"])
def test_rejected_words_are_found(words: str) -> None:
    assert len(found_in([Text("a:1", words)])) == 1


def test_code_and_times_are_accepted() -> None:
    assert found_in([Text("a:1", "`nobody` is no longer there; it is no more than 3 m")]) == []


def test_long_sentences_are_found_where_they_are_counted() -> None:
    long = "word " * 25 + "end. Short one."
    assert found_in([Text("a:1", long)]) == []
    assert found_in([Text("a:1", long, short=True)]) == [f"a:1: 26 words in {long[:-11]!r}"]


def test_a_page_is_read_in_pieces_without_its_code() -> None:
    page = (
        "# Head\n\nA [link](nobody.md).\n```\nnobody\n```\n- one\n- two,\n  whoever\n\n| a | b |\n"
    )
    read = list(check_words.of_markdown("p.md", page))
    assert [text.text.strip() for text in read] == [
        "# Head", "A link.", "- one", "- two,\n  whoever", "a", "b"
    ]  # fmt: skip
    assert found_in(read) == ["p.md:8: 'whoever' in '- two, whoever'"]


def test_python_is_read_by_kind() -> None:
    source = '"""First.\n\nRest.\n"""\n\nX = "string"  # nobody\n# is\n# no robot\n'
    read = list(check_words.of_python("a.py", source))
    assert [(text.text.strip(), text.short) for text in read] == [
        ("First.", True),
        ("Rest.", False),
        ("string", False),
        ("nobody is no robot", False),
    ]


def test_lists_of_names_count_as_one_word() -> None:
    names = ", ".join(["`name`"] * 30)
    assert found_in([Text("a:1", f"It has {names} and `other`.", short=True)]) == []


def test_bold_sentences_end() -> None:
    half = "word " * 20
    assert found_in([Text("a:1", f"**{half}end.** {half}end.", short=True)]) == []


def test_names_of_tests_are_read_and_their_data_is_not() -> None:
    source = 'def test_who_waits() -> None:\n    """Doc."""\n    frame = "nobody"  # is no x\n'
    assert found_in(check_words.of_tests("a.py", source)) == [
        "a.py:1: 'who' in 'test who waits'",
        "a.py:3: 'is no' in 'is no x'",
    ]


def test_cpp_strings_and_comments_are_joined() -> None:
    read = list(check_words.of_cpp("a.cpp", 'f("is "\n  "no x");\n// is\n// no y\n'))
    assert found_in(read) == ["a.cpp:1: 'is no' in 'is no x'", "a.cpp:2: 'is no' in 'is no y'"]


def test_help_of_every_level_is_read() -> None:
    places = {text.place for text in check_words.of_help()}
    assert {"tfdb --help", "tfdb info", "tfdb info --wide", "tfdb shm rm --help"} <= places
