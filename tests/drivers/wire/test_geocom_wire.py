"""Lines of GeoCOM: written and read again, cut anywhere, damaged, and plain garbage."""

import pytest
from geocompy.communication import crc16_bytewise
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import WireError
from drivers.wire import geocom as wire
from drivers.wire.geocom_constants import procedure_text, result_text

numbers = st.integers(0, 999_999_999)
texts = st.text(st.characters(codec="latin-1"), max_size=20)
words = (
    st.floats(-1e6, 1e6).map(lambda value: wire.number_word(value, 10))
    | st.integers(-99999, 99999).map(str)
    | texts.map(wire.string_word)
    | st.sampled_from(["'0a'", ""])
)
parameters = st.lists(words, max_size=8).map(tuple).filter(lambda found: found != ("",))
requests = st.builds(wire.GeocomRequest, numbers, numbers, parameters, st.booleans())
replies = st.builds(wire.GeocomReply, numbers, numbers, numbers, parameters, st.booleans())


def without_end(line):
    assert line.endswith(b"\r\n")
    return line[:-2]


class TestLines:
    @given(requests)
    def test_request_is_read_as_it_was_written(self, request):
        assert wire.decode_request(without_end(wire.encode_request(request))) == request

    @given(replies)
    def test_reply_is_read_as_it_was_written(self, reply):
        assert wire.decode_reply(without_end(wire.encode_reply(reply))) == reply

    def test_examples_of_the_manual_and_what_they_leave_out_are_read(self):
        request = wire.GeocomRequest(2082, 7, wire.words_of(5000, 1))
        assert wire.encode_request(request) == b"%R1Q,2082,7:5000,1\r\n"
        reply = wire.GeocomReply(0, 0, 0, ("1996", "'07'", "'19'", "'10'", "'13'", "'2f'"))
        assert wire.decode_reply(b"%R1P,0,0:0,1996,'07','19','10','13','2f'") == reply
        assert wire.decode_request(b"%R1Q,5008:") == wire.GeocomRequest(5008)
        assert wire.decode_request(b"c") is None
        assert wire.decode_reply(b'%R1P,0,3:0,"a,\\"b",2').parameters == ('"a,\\"b"', "2")

    @pytest.mark.parametrize(
        "line",
        [
            b"",
            b"%R1Q",
            b"%R1Q,:",
            b"%R1Q,1,2",
            b"%R1Q, 1,2:",
            b"%R1Q,1,2,3,4:",
            b"%R1Q,1234567890:",
            b"%R1P,0,1:0",
            b'%R1Q,1,2:"open',
            b"%R1Q,1,2:\x80",
            b"%R1Q,1,2:" + b"1," * wire.LINE_BYTES,
            b"C",
        ],
    )
    def test_anything_else_is_no_request(self, line):
        with pytest.raises(WireError):
            wire.decode_request(line)

    @pytest.mark.parametrize(
        "line",
        [
            b"%R1P,0:0",
            b"%R1P,0,1:",
            b"%R1P,0,1:x",
            b"%R1P,-1,1:0",
            b"%R1P,00,1:0",
            b"%R1Q,0,1:0",
            b" %R1P,0,1:0",
            b'%R1P,0,1:0,"open',
            b"?",
        ],
    )
    def test_anything_else_is_no_reply(self, line):
        with pytest.raises(WireError):
            wire.decode_reply(line)

    def test_line_that_is_too_long_or_not_ascii_is_not_written(self):
        with pytest.raises(WireError, match="the limit is 1024"):
            wire.encode_request(wire.GeocomRequest(1, 1, wire.words_of("x" * wire.LINE_BYTES)))
        with pytest.raises(WireError, match="not printable ASCII"):
            wire.encode_request(wire.GeocomRequest(1, 1, ("°",)))


class TestChecksum:
    def test_check_value_of_the_catalogue(self):
        assert wire.crc16(b"123456789") == 0xBB3D

    @given(st.binary())
    def test_sum_is_that_of_geocompy(self, data):
        assert wire.crc16(data) == crc16_bytewise(data)

    @given(replies.filter(lambda reply: reply.checked), st.data())
    def test_flipped_bit_is_noticed(self, reply, data):
        line = bytearray(without_end(wire.encode_reply(reply)))
        line[data.draw(st.integers(0, len(line) - 1))] ^= 1 << data.draw(st.integers(0, 6))
        try:
            read = wire.decode_reply(bytes(line))
        except WireError:
            return
        # its own separator was hit, so that there is no checksum any more
        assert not read.checked

    def test_damaged_request_keeps_its_number_for_the_refusal(self):
        line = without_end(
            wire.encode_request(wire.GeocomRequest(2008, 17, ("1", "1"), checked=True))
        )
        with pytest.raises(wire.BadChecksum) as caught:
            wire.decode_request(line.replace(b":1,1", b":1,2"))
        assert caught.value.transaction == 17


class TestFramer:
    def test_empty_lines_and_the_answer_to_an_abort_are_passed_over(self):
        assert wire.replies()(b"\r\n?\r\n%R1P,0,4:0\r\n\n") == [wire.GeocomReply(0, 4, 0)]

    def test_line_without_an_end_is_refused_and_not_kept(self):
        with pytest.raises(WireError):
            wire.replies()(b"%R1P,0,1:0," + b"9" * 100_000)
        assert len(wire.line_framer().feed(b"9" * 100_000)[0]) == wire.LINE_BYTES + 1


class TestWords:
    @given(texts)
    def test_string_is_read_as_it_was_written(self, text):
        word = wire.string_word(text)
        assert word.isascii()
        assert word.isprintable()
        assert wire.parse_string(word) == text

    def test_numbers_have_their_point_and_whole_ones_none(self):
        assert wire.string_word('50 % "°" \\ ~') == r'"50 \% \"\xB0\" \\ \~"'
        assert wire.words_of(1, True, 2.0, "x") == ("1", "1", "2.0", '"x"')
        with pytest.raises(WireError, match="1 parameters where 2"):
            wire.parse_words(("1",), 2)

    @given(st.floats(-1e6, 1e6), st.integers(0, 15))
    def test_number_is_read_as_it_was_rounded(self, value, digits):
        assert wire.parse_number(wire.number_word(value, digits)) == pytest.approx(
            value, abs=0.51 * 10.0 ** -max(digits, 1), rel=1e-15
        )

    @pytest.mark.parametrize(("value", "word"), [(100.0, "100.0"), (0.0, "0.0"), (1.25, "1.2")])
    def test_number_always_has_its_point(self, value, word):
        assert wire.number_word(value, 1) == word

    @pytest.mark.parametrize(
        ("parse", "word"),
        [
            (wire.parse_whole, "1.0"),
            (wire.parse_whole, ""),
            (wire.parse_number, "nan"),
            (wire.parse_number, "1,5"),
            (wire.parse_string, "x"),
            (wire.parse_string, '"x'),
            (wire.parse_string, '"a"b"'),
        ],
    )
    def test_word_of_another_kind_is_refused(self, parse, word):
        with pytest.raises(WireError):
            parse(word)


class TestTexts:
    def test_codes_and_procedures_have_words_or_keep_their_number(self):
        assert result_text(8710) == "GeoCOM 8710 (aut no target)"
        assert procedure_text(2082) == "TMC_GET_COORDINATE"
        assert (result_text(4711), procedure_text(4711)) == ("GeoCOM 4711", "procedure 4711")
