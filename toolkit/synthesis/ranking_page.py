"""A page on which a person ranks results without knowing which method made which (Dong, section 6.3.1)."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping
from pathlib import Path

from intaglio.arrays import Array, PathLike
from intaglio.errors import InputError
from intaglio.files import READABLE_SUFFIXES, check_readable, inline_image, read_image, write_page
from intaglio.synthesis.ranks import LABELS

SAMPLE = "sample"

_SCRIPT = """
const trials = JSON.parse(document.getElementById('trials').textContent);
const decoded = m => new TextDecoder().decode(Uint8Array.from(atob(m), c => c.codePointAt(0)));
const answers = {};
let order = [], at = 0, observer = '';
function randomFrom(text) {  // mulberry32, from a hash of the text: the same observer sees the same order again
  let h = 2166136261;
  for (const c of text) { h ^= c.codePointAt(0); h = Math.imul(h, 16777619); }
  return () => { h = h + 0x6D2B79F5 | 0; let t = Math.imul(h ^ h >>> 15, 1 | h);
    t = t + Math.imul(t ^ t >>> 7, 61 | t) ^ t; return ((t ^ t >>> 14) >>> 0) / 4294967296; };
}
function shuffled(list, random) {
  const a = list.slice();
  for (let i = a.length - 1; i > 0; i--) { const j = Math.floor(random() * (i + 1)); [a[i], a[j]] = [a[j], a[i]]; }
  return a;
}
const page = document.getElementById('page');
function begin() {
  observer = document.getElementById('observer').value.trim();
  if (!observer) { document.getElementById('say').textContent = 'Please give a name or number.'; return; }
  order = shuffled(trials.map((_, i) => i), randomFrom(trials.seed + observer));
  show();
}
function show() {
  if (at == order.length) { finish(); return; }
  const trial = trials[order[at]], k = trial.results.length;
  const shown = shuffled(trial.results, randomFrom(observer + '/' + trial.texture));
  const choices = [...Array(k).keys()].map(i => `<option>${i + 1}</option>`).join('');
  page.innerHTML = `<p>${at + 1} of ${order.length}. Which result looks most like more of the sample? 1 is best.
    Equal ones may have equal ranks.</p>
    <figure><img src="${trial.sample}"><figcaption>sample</figcaption></figure><div class=row>`
    + shown.map((r, i) => `<figure><img src="${r.image}"><figcaption>Result ${i + 1}: rank
    <select data-m="${r.method}"><option></option>${choices}</select></figcaption></figure>`).join('')
    + '</div><p><button id=next>Next</button> <span id=say></span></p>';
  document.getElementById('next').onclick = () => {
    const given = [...page.querySelectorAll('select')].map(s => [s.dataset.m, Number(s.value)]);
    if (given.some(g => !g[1])) { document.getElementById('say').textContent = 'Every result needs a rank.'; return; }
    // Equal ranks share the mean of their places.
    const places = {};
    for (const [m, v] of given) {
      const below = given.filter(g => g[1] < v).length, same = given.filter(g => g[1] == v).length;
      places[m] = below + (same + 1) / 2;
    }
    answers[trial.texture] = places; at++; show(); window.scrollTo(0, 0);
  };
}
const quoted = t => '"' + t.replaceAll('"', '""') + '"';
function finish() {
  const methods = trials[0].results.map(r => r.method);
  const lines = [['texture', 'observer', ...methods.map(m => quoted(decoded(m)))].join(',')];
  for (const trial of trials)
    lines.push([quoted(trial.texture), quoted(observer), ...methods.map(m => answers[trial.texture][m])].join(','));
  const text = lines.join('\\n') + '\\n';
  page.innerHTML = '<p>Thank you. Save the ranks, and give the file to whoever asked you.</p>'
    + '<p><a id=save>Save ranks</a></p><pre></pre>';
  page.querySelector('pre').textContent = text;
  const link = document.getElementById('save');
  link.href = URL.createObjectURL(new Blob([text], {type: 'text/csv'}));
  link.download = 'ranks_' + observer.replace(/[^A-Za-z0-9]+/g, '_') + '.csv';
}
document.getElementById('begin').onclick = begin;
"""


def write_ranking_page(
    path: PathLike,
    trials: Mapping[str, tuple[Array, Mapping[str, Array]]],
    *,
    title: str = "Rank the results",
    seed: int = 0,
) -> None:
    """Write a page that shows samples and results in random order and saves the ranks given as CSV.

    It works offline, in one file. Methods are not named, and the order in which textures and results come depends on the
    observer's name and ``seed`` alone.

    Parameters
    ----------
    path : path
        .html
    trials : dict of str to (sample, dict of str to result)
        For each texture the sample, a linear picture (H, W, 1 or 3), and each method's result. All have the same methods.
    title : str
    seed : int

    Raises
    ------
    InputError
        If there is no texture, fewer than three methods, or textures differ in methods.
    """
    if not trials:
        raise InputError("there is no texture to rank; give at least one")
    methods = sorted(next(iter(trials.values()))[1])
    if len(methods) < 3:
        raise InputError(f"ranks of {len(methods)} methods can't be tested; give results of at least 3")
    taken = [m for m in methods if m.lower() in LABELS]
    if taken:
        raise InputError(f"a method can't be called {', '.join(taken)}: tables of ranks have columns of that name")
    data = []
    for texture, (sample, results) in trials.items():
        if sorted(results) != methods:
            raise InputError(f"{texture} has results of {', '.join(sorted(results))}, not of {', '.join(methods)}")
        images = [
            {"method": base64.b64encode(m.encode("utf-8", "replace")).decode(), "image": inline_image(results[m])}
            for m in methods
        ]
        data.append({"texture": texture, "sample": inline_image(sample), "results": images})
    listed = json.dumps(data).replace("<", "\\u003c")
    body = [
        f"<div id=page><p>You will see {len(data)} samples of textures, and under each {len(methods)} larger pictures made "
        "from it. Rank them by how much they look like more of the same.</p>"
        "<p>Your name or number: <input id=observer> <button id=begin>Begin</button> <span id=say></span></p></div>",
        f'<script type="application/json" id="trials">{listed}</script>',
        f"<script>{_SCRIPT.replace('trials.seed', html.escape(json.dumps(str(seed)), quote=False))}</script>",
        "<style>.row figure{flex:0 1 auto;margin-bottom:1em}.row img{width:auto;max-width:100%}</style>",
    ]
    write_page(path, title, body)


def read_trials(folder: PathLike) -> dict[str, tuple[Array, dict[str, Array]]]:
    """Read a study: a folder per texture, in it ``sample.png`` and one picture per method, named for it.

    Raises
    ------
    InputError, FileError
        If there is no such folder, or a picture is missing or can't be read.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; a study has a folder for each texture")
    trials: dict[str, tuple[Array, dict[str, Array]]] = {}
    for inner in sorted(p for p in folder.iterdir() if p.is_dir() and not p.name.startswith(".")):
        pictures = {p.stem: p for p in sorted(inner.iterdir()) if p.suffix.lower() in READABLE_SUFFIXES}
        if SAMPLE not in pictures:
            raise InputError(f"{inner}: has no picture called sample; put the sample there as sample.png")
        read = {name: _picture(path) for name, path in pictures.items()}
        sample = read.pop(SAMPLE)
        trials[inner.name] = (sample, read)
    if not trials:
        raise InputError(
            f"{folder}: holds no folders; a study has one for each texture, with sample.png and a picture per method"
        )
    return trials


def _picture(path: Path) -> Array:
    image = read_image(check_readable(path))
    return image[:, :, :3] if image.ndim == 3 else image[:, :, None]
