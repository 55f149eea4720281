"""Collada files as text."""

from __future__ import annotations

from tests.support.patches import BOX

DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Z_UP</up_axis></asset>
<library_images><image id="i"><init_from>{picture}</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="s"><sampler2D><source>f</source></sampler2D></newparam>
<technique sid="c"><lambert><diffuse>{diffuse}</diffuse></lambert></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m" name="skin"><instance_effect url="#e"/></material>
</library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="72">{points}</float_array><technique_common>
<accessor source="#pa" count="24" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="t"><float_array id="ta" count="48">{uv}</float_array><technique_common>
<accessor source="#ta" count="24" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<{kind} count="{count}" material="a"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#t" offset="1" set="0"/>{vcount}<p>{index}</p></{kind}>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><translate>1 2 3</translate><node>
<instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="a" target="#m"><bind_vertex_input_set semantic="uv"
 input_semantic="TEXCOORD" input_set="0"/></instance_material>
</technique_common></bind_material></instance_geometry></node></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


def dae(kind: str = "triangles", picture: str = "skin.png", shown: bool = True) -> str:
    quads = [[4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 3] for k in range(6)]
    rows = BOX.faces.tolist() if kind == "triangles" else quads
    return DAE.format(
        picture=picture,
        diffuse='<texture texture="s" texcoord="uv"/>' if shown else "<color>1 0 0 1</color>",
        points=" ".join(map(str, (BOX.vertices * 100 - (1, 2, 3)).reshape(-1).tolist())),
        uv=" ".join(map(str, BOX.uv.reshape(-1).tolist())),
        kind=kind,
        count=len(rows),
        vcount="" if kind == "triangles" else f"<vcount>{'4 ' * 6}</vcount>",
        index=" ".join(f"{k} {k}" for row in rows for k in row),
    )
