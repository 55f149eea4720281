"""The look of a report: one HTML template that needs nothing from outside.

Never computes what it shows. What comes from files (names, messages) is escaped by the template
engine; without JavaScript all of it can still be read.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; background: #fff; margin: 2rem auto;
       max-width: 1080px; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0; } h2 { font-size: 1.1rem; margin-top: 2rem; }
p.verdict { margin-top: .2rem; color: #555; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { padding: .15rem .7rem; text-align: right; border-bottom: 1px solid #e4e4e4; }
td.text, th.text { text-align: left; }
th { font-weight: 600; } thead th { position: sticky; top: 0; background: #fff; }
tr.bad td { color: #b2182b; } tr:target td, tr.chosen td { background: #fff3c4; }
table.facts td { text-align: left; border: 0; padding: 0 1.2rem 0 0; vertical-align: top; }
table.facts td:first-child { color: #777; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(240px, 1fr)); gap: 8px; }
figure { margin: 0; } figure img { width: 100%; display: block; }
figcaption { font-size: .8rem; line-height: 1.3; padding: .2rem 0 .4rem; }
figcaption a { color: inherit; } figure.bad figcaption { color: #b2182b; }
.curves { position: relative; cursor: crosshair; } .curves svg { width: 100%; height: auto; }
.cross { position: absolute; top: 0; bottom: 0; width: 1px; background: #222; display: none; }
.says { min-height: 1.5em; font-size: .85rem; color: #333; }
pre { overflow-x: auto; font-size: .72rem; } .wide { overflow-x: auto; }
button { font: inherit; padding: .1rem .7rem; } .key { font-size: .85rem; color: #555; }
"""

SCRIPT = """
const rows = [...document.querySelectorAll('tr[data-frame]')];
const byFrame = new Map(rows.map(row => [Number(row.dataset.frame), row]));
const curves = document.querySelector('.curves');
const choose = row => {
  rows.forEach(other => other.classList.toggle('chosen', other === row));
  row.scrollIntoView({block: 'center'});
};
if (curves) {
  const cross = curves.querySelector('.cross'), says = document.querySelector('.says');
  const {left, right, first, last} = curves.dataset;
  const under = event => {
    const box = curves.getBoundingClientRect();
    const share = ((event.clientX - box.left) / box.width - left) / (right - left);
    const frame = Math.round(Number(first) + share * (last - first));
    cross.style.left = `${event.clientX - box.left}px`;
    return byFrame.get(frame);
  };
  curves.addEventListener('mousemove', event => {
    const row = under(event);
    cross.style.display = row ? 'block' : 'none';
    says.textContent = row ? row.dataset.says : '';
  });
  curves.addEventListener('click', event => { const row = under(event); if (row) choose(row); });
}
const button = document.querySelector('button.order');
if (button) button.addEventListener('click', () => {
  const key = button.dataset.key === 'rank' ? 'frame' : 'rank';
  button.dataset.key = key;
  button.textContent = key === 'rank' ? 'order by frame' : 'worst first';
  rows.sort((a, b) => a.dataset[key] - b.dataset[key]);
  rows[0].parentNode.append(...rows);
});
document.body.dataset.rows = rows.length;
"""

PAGE = """\
<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{{ title }}</title>
<style>{{ style | safe }}</style>
</head>
<body>
<h1>{{ title }}</h1>
<p class="verdict">{{ verdict }}</p>
{% if facts %}
<table class="facts">
{% for name, value in facts.items() %}<tr><td>{{ name }}</td><td>{{ value }}</td></tr>
{% endfor %}</table>
{% endif %}
{% if curves %}
<h2>Over the frames</h2>
<div class="curves" {% for name, value in limits.items() %}data-{{ name }}="{{ value }}" \
{% endfor %}>{{ curves | safe }}<div class="cross"></div></div>
<div class="says"></div>
<p class="key">{{ key }}</p>
{% endif %}
{% for heading, note, pictures in galleries %}
<h2>{{ heading }}</h2>
<p class="key">{{ note }}</p>
<div class="pictures">
{% for picture in pictures %}
<figure{% if picture.bad %} class="bad"{% endif %}><img src="{{ picture.data }}" \
alt="frame {{ picture.frame }}"><figcaption><a href="#f{{ picture.frame }}">\
frame {{ picture.frame }}</a> {{ picture.caption }}</figcaption></figure>
{% endfor %}
</div>
{% endfor %}
{% if text %}<pre>{{ text }}</pre>{% endif %}
{% for table in tables %}
<h2>{{ table.heading }}</h2>
{% if table.frames %}<p><button class="order" data-key="rank">order by frame</button></p>{% endif %}
<div class="wide"><table>
<thead><tr>{% for cell in table.head %}<th{% if cell.text %} class="text"{% endif %}>\
{{ cell.shown }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in table.rows %}
<tr{% if row.bad %} class="bad"{% endif %}{% if table.frames %} id="f{{ row.frame }}" \
data-frame="{{ row.frame }}" data-rank="{{ loop.index0 }}" data-says="{{ row.says }}"{% endif %}>\
{% for cell in row.cells %}<td{% if cell.text %} class="text"{% endif %}>\
{% if cell.link %}<a href="{{ cell.link }}">{{ cell.shown }}</a>{% else %}{{ cell.shown }}\
{% endif %}</td>{% endfor %}</tr>
{% endfor %}
</tbody></table></div>
{% endfor %}
<script>{{ script | safe }}</script>
</body>
</html>
"""


def fill(**content: Any) -> str:
    """The page's text. What is not given is left out; `title` and `verdict` always are."""
    nothing: dict[str, Any] = {
        "facts": {}, "curves": "", "limits": {}, "key": "", "galleries": [], "tables": [],
        "text": "",
    }  # fmt: skip
    text: str = _template().render(**{**nothing, "style": STYLE, "script": SCRIPT, **content})
    return text


@lru_cache(maxsize=1)
def _template() -> Any:
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.from_string(PAGE)
