# SPDX-License-Identifier: Apache-2.0

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from selections import selection, sensor

from cmifs_ros.collect.advice import advice_of
from cmifs_ros.collect.traffic import Rate
from cmifs_ros.core import ConditionalMISelector, Episode
from cmifs_ros.core.effect import Effect
from cmifs_ros.tools.html_report import write_report

NAMES = ('x', 'y', 'battery', 'noise')


def make_episodes(count=12, num_channels=4):
    rng = np.random.default_rng(0)
    return ConditionalMISelector().thin(
        [Episode(rng.normal(size=(5, num_channels)), rng.normal(size=5)) for _ in range(count)]
    )


X = sensor('x', 0.25, is_selected=True, pvalue=0.0012, status='confirmed', stability=1.0)
Y = sensor('y', 0.375, is_selected=True, pvalue=0.2, stability=0.75)
BATTERY = sensor(
    'battery', 0.36, pvalue=0.9, status='dispensable', null_band=(0.35, 0.36, 0.37),
    stability=0.125, effect=Effect(-0.001, 0.002),
)  # fmt: skip
SELECTION = selection(X, Y, BATTERY, predicted_share=0.5, predicted_share_of_all=0.25)
#: As a method without evidence gives it.
BARE = selection(sensor('x', is_selected=True), sensor('y', is_selected=True), sensor('battery'))


class Page(HTMLParser):
    """The tags and the text of a page; it fails where a tag is closed that is not open."""

    def __init__(self, path):
        super().__init__()
        self.tags, self.attributes, self.texts, self._open = [], [], [], []
        self.source = path.read_text(encoding='utf-8')
        self.feed(self.source)
        assert self._open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.attributes += attributes
        if tag not in ('meta', 'img'):
            self._open.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)

    @property
    def pictures(self):
        found = re.findall(r'src="data:image/png;base64,([^"]*)"', self.source)
        return [base64.b64decode(data, validate=True) for data in found]


def test_the_page_shows_the_evidence_of_each_sensor_and_what_was_dropped(tmp_path):
    path = write_report(tmp_path / 'new', SELECTION, make_episodes(), NAMES, {'late': 7, 'lost': 0})
    page = Page(path)
    assert path == tmp_path / 'new' / 'index.html'
    rows = [re.sub(r'<[^>]*>', '|', row) for row in re.findall(r'<tr>.*?</tr>', page.source)]
    (row,) = [row for row in rows if '|battery|' in row and '|3|' in row]
    for cell in (
        '-0.1%', 'below 0.3%', 'dispensable', '0.9', '12%', '0.360', '0.350 to 0.370',
    ):  # fmt: skip
        assert f'|{cell}|' in row, (cell, row)
    assert any('|late|' in row and '|7|' in row for row in rows)
    assert not any('|lost|' in row for row in rows)
    assert 'supporting channels' not in page.source
    assert len(page.pictures) == 4
    assert all(data.startswith(b'\x89PNG') for data in page.pictures)


def test_sensors_that_never_changed_stand_below_the_table(tmp_path):
    still = selection(X, Y, replace(BATTERY, is_constant=True, supporting_channels=()))
    page = Page(write_report(tmp_path, still, make_episodes(), NAMES, {}))
    assert '<td class="name">battery</td>' not in page.source
    assert '<p>Constant, and therefore uninformative: battery</p>' in page.source


def test_channels_are_named_where_they_are_not_the_sensor_itself(tmp_path):
    grouped = selection(X, replace(Y, supporting_channels=('y.sin', 'y.cos')), BATTERY)
    page = Page(write_report(tmp_path, grouped, make_episodes(), NAMES, {}))
    assert '<th>supporting channels</th>' in page.source
    assert '<td class="name">y.sin, y.cos</td>' in page.source
    assert '<td class="name">x</td><td class="name">' not in page.source


def test_the_page_names_what_a_sensor_is_redundant_with(tmp_path):
    replaced = selection(X, Y, replace(BATTERY, redundant_with=('x', 'y')))
    page = Page(write_report(tmp_path, replaced, make_episodes(), NAMES, {}))
    assert '<th>redundant with</th>' in page.source
    assert page.source.count('<td class="name">x, y</td>') == 1


def test_warnings_come_before_all_else(tmp_path):
    warned = replace(SELECTION, warnings=('1 < 2 rewards',))
    page = Page(write_report(tmp_path, warned, make_episodes(), NAMES, {}))
    start, _, rest = page.source.partition('<p class="warning">1 &lt; 2 rewards</p>')
    assert '<h1>' in start
    assert '<p>' not in start
    assert '<h2>' in rest


def test_the_page_ends_with_what_to_keep_and_what_can_go(tmp_path):
    topics = {'x': '/pose', 'y': '/pose', 'battery': '/<b>', 'noise': '/noise'}
    advice = advice_of(SELECTION, topics, {'/<b>': Rate(10.0, 2500.0)})
    page = Page(write_report(tmp_path, SELECTION, make_episodes(), NAMES, {}, advice=advice))
    end = page.source.partition('<h2>What to keep, and what can go</h2>')[2]
    keep, can_go, undecided = end.split('<h3>')[1:]
    assert 'Keep these</h3><ul><li>/pose: ' in keep
    assert '<li>/&lt;b&gt;: battery adds at most 0.2%; 10 messages/s, 2.5 kB/s</li>' in can_go
    assert '<li>/noise: not tested</li>' in undecided
    by_sensor = Page(write_report(tmp_path, SELECTION, make_episodes(), NAMES, {}))
    assert '<li>battery: adds at most 0.2%</li>' in by_sensor.source


def test_a_decision_says_why(tmp_path):
    why = [replace(X, why='reward'), replace(Y, why='predicts x')]
    decision = selection(*why, BATTERY, target='decision')
    page = Page(write_report(tmp_path, decision, make_episodes(), NAMES, {}))
    assert '<td class="name">predicts x -&gt; reward</td>' in page.source
    assert 'or of a next value' in page.source
    assert len(page.pictures) == 5


def test_the_page_needs_no_network_and_runs_nothing(tmp_path):
    page = Page(write_report(tmp_path, SELECTION, make_episodes(), NAMES, {}))
    assert not {'script', 'link', 'iframe', 'object'} & set(page.tags)
    assert all(v.startswith('data:') for k, v in page.attributes if k in ('src', 'href'))
    assert not re.search(r'https?://|url\(|@import', page.source)


def test_evidence_that_is_not_there_is_not_shown(tmp_path):
    page = Page(write_report(tmp_path, BARE, make_episodes(), NAMES, {}))
    assert '<th>p</th>' not in page.source
    assert '<th>status</th>' not in page.source
    assert 'What to keep' not in page.source
    assert 'Nothing was dropped.' in page.source


def test_nothing_selected_is_said(tmp_path):
    nothing = selection(sensor('x'), sensor('y'))
    page = Page(write_report(tmp_path, nothing, make_episodes(), NAMES, {}))
    assert 'no evidence that any sensor is informative about the return' in page.source


@settings(max_examples=8)
@given(st.text(min_size=1, max_size=40), st.text(max_size=40))
def test_a_name_is_text_whatever_it_holds(tmp_path_factory, name, cause):
    name, cause = f'<b onload=x>&"{name}$', f'<script>{cause}'
    named = selection(replace(X, name=name, channels=(name,)), Y, BATTERY)
    folder = tmp_path_factory.mktemp('report')
    page = Page(write_report(folder, named, make_episodes(), (name, *NAMES[1:]), {cause: 1}))
    assert not {'b', 'script'} & set(page.tags)
    assert 'onload' not in dict(page.attributes)
    assert any('<b onload=x>&"' in text for text in page.texts)


def test_a_constant_channel_and_many_channels_are_shown_without_a_warning(tmp_path, recwarn):
    rng = np.random.default_rng(1)
    states = rng.normal(size=(6, 100))
    states[:, 3] = 1.0
    names = [f'c{i}' for i in range(100)]
    many = selection(*(sensor(name, is_selected=name in ('c0', 'c3')) for name in names))
    many = replace(many, indices=(0, 3))
    page = Page(
        write_report(
            tmp_path, many, ConditionalMISelector().thin([Episode(states, np.ones(6))]), names, {}
        )
    )
    assert len(page.pictures) == 3
    assert [str(w.message) for w in recwarn] == []


def test_what_does_not_fit_together_is_refused(tmp_path):
    with pytest.raises(ValueError, match='there are 3 names; expected 4'):
        write_report(tmp_path, SELECTION, make_episodes(), NAMES[:3], {})


def test_without_the_episodes_the_rest_is_shown(tmp_path):
    doubted = replace(SELECTION, doubt='the data have changed')
    page = Page(write_report(tmp_path, doubted, dropped={'late': '7'}))
    assert '<p class="warning">the data have changed</p>' in page.source
    assert '<p>From 25 episodes, 60 steps, in 1.2 s.</p>' in page.source
    assert '|late|' in re.sub(r'<[^>]*>', '|', page.source)
    assert '<h2>Returns</h2>' not in page.source
    assert len(page.pictures) == 2
