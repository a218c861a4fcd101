/** The text of src/farfield/represent/geometry/dictionary.txt, to the letter. */
export const DICTIONARY_TEXT = String.raw`# What GLBs of near geometry are deflated with (spec/world.md, Geometry of a leaf). What is most common comes last.
# What is rare: unlit materials, cut-outs, colours of vertices.
extensionsUsed":["EXT_mesh_features","KHR_draco_mesh_compression","KHR_materials_unlit"],"extensionsRequired
"doubleSided":false,"pbrMetallicRoughness"
"baseColorTexture":{"index":0}},"alphaMode":"MASK","alphaCutoff":0.5,"extensions":{"KHR_materials_unlit":{}}}
{"attributes":{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"COLOR_0":3,"_FEATURE_ID_0":4},"indices":5,
"extensions":{"KHR_draco_mesh_compression":{"bufferView":0,"attributes":{"POSITION":4,"NORMAL":3,"TEXCOORD_0":2,
"COLOR_0":1,"_FEATURE_ID_0":0}},
{"attributes":{"POSITION":0,"NORMAL":1,"COLOR_0":2,"_FEATURE_ID_0":3},"indices":4,
"extensions":{"KHR_draco_mesh_compression":{"bufferView":0,"attributes":{"POSITION":3,"NORMAL":2,"COLOR_0":1,
"_FEATURE_ID_0":0}},
},{"componentType":5123,"type":"VEC4","normalized":true,"count":
\x05\x02\x00\x00\x03\x00\x00\xff\x00\x00\x00\x00\x00\x01\x00\x00\x01\x04\x04\x01\x00\x00\x01\x01\x04\x04\x04\x00\x01\x01
\x01\x00\x09\x03\x00\x04\x02\x01\x03\x09\x02\x01\x02\x02\x01\x01\x09\x03\x00\x03\x03
\x04\x01\x00\x00\x02\x00\x00\xff\x00\x00\x00\x00\x00\x01\x04\x09\x01\x00\x00\x00\x01\x04\x04\x04\x00\x01\x01\x01\x00\x09
\x03\x00\x03\x02\x01\x01\x09\x03\x00\x02\x03\x01\x01
# Several primitives.
},"material":0},{"attributes":{"POSITION":4,"NORMAL":5,"_FEATURE_ID_0":6},"indices":7,
"extensions":{"KHR_draco_mesh_compression":{"bufferView":1,"attributes":{"POSITION":2,"NORMAL":1,"_FEATURE_ID_0":0}},
"EXT_mesh_features":{"featureIds":[{"attribute":0,"featureCount":1}]}},"material":1},{"attributes":{"POSITION":8,
"NORMAL":9,"_FEATURE_ID_0":10},"indices":11,"extensions":{"KHR_draco_mesh_compression":{"bufferView":2,
"attributes":{"POSITION":2,"NORMAL":1,"_FEATURE_ID_0":0}},"EXT_mesh_features":{"featureIds":[{"attribute":0,
"featureCount":1}]}},"material":2}
,{"attributes":{"POSITION":5,"NORMAL":6,"TEXCOORD_0":7,"_FEATURE_ID_0":8},"indices":9,
"extensions":{"KHR_draco_mesh_compression":{"bufferView":1,"attributes":{"POSITION":3,"NORMAL":2,"TEXCOORD_0":1,
"_FEATURE_ID_0":0}},"EXT_mesh_features":{"featureIds":[{"attribute":0,"featureCount":1}]}},"material":1},
{"attributes":{"POSITION":10,"NORMAL":11,"TEXCOORD_0":12,"_FEATURE_ID_0":13},"indices":14,
"extensions":{"KHR_draco_mesh_compression":{"bufferView":2,"attributes":{"POSITION":3,"NORMAL":2,"TEXCOORD_0":1,
"_FEATURE_ID_0":0}},"EXT_mesh_features":{"featureIds":[{"attribute":0,"featureCount":1}]}},"material":2}
{"doubleSided":true,"pbrMetallicRoughness":{"metallicFactor":0.0,"roughnessFactor":1.0,
"baseColorFactor":[1.0,1.0,1.0,1.0],"baseColorTexture":{"index":0}}},{"doubleSided":true,
"pbrMetallicRoughness":{"metallicFactor":0.0,"roughnessFactor":1.0,"baseColorFactor":[1.0,1.0,1.0,1.0],
"baseColorTexture":{"index":1}}},{"doubleSided":true,"pbrMetallicRoughness":{"metallicFactor":0.0,
"roughnessFactor":1.0,"baseColorFactor":[1.0,1.0,1.0,1.0],"baseColorTexture":{"index":2}}}],"textures":[{"source":0},
{"source":1},{"source":2}],"images":[{"uri":"../../../../texture/"},{"uri":"../../../../texture/
# A leaf of instances alone.
{"asset":{"version":"2.0","generator":"farfield"},"scene":0,"accessors":[{"componentType":5126,"type":"MAT4",
"count":1,"bufferView":0},{"componentType":5125,"type":"SCALAR","count":1,"bufferView":1},{"componentType":5126,
"type":"MAT4","count":1,"bufferView":2},{"componentType":5125,"type":"SCALAR","count":1,"bufferView":3},
{"componentType":5126,"type":"MAT4","count":1,"bufferView":4},{"componentType":5125,"type":"SCALAR","count":1,
"bufferView":5}],"bufferViews":[{"buffer":0,"byteLength":64},{"buffer":0,"byteLength":4,"byteOffset":64},{"buffer":0,
"byteLength":64,"byteOffset":68},{"buffer":0,"byteLength":4,"byteOffset":132}
"scenes":[{"nodes":[],"extras":{"farfield":{"cell":"0/0/0/0","instances":[{"mesh":"","transforms":0,"objects":1},
{"mesh":"","transforms":2,"objects":3},{"mesh":"
# A textured mesh, and a leaf of textured ground with instances.
\x05\x00\x00JSON{"asset":{"version":"2.0","generator":"farfield"},"extensionsUsed":["EXT_mesh_features",
"KHR_draco_mesh_compression"],"extensionsRequired":["KHR_draco_mesh_compression"],"scene":0,"nodes":[{"mesh":0,
"matrix":[1.0,0.0,0.0,0.0,0.0,0.0,-1.0,0.0,0.0,1.0,0.0,0.0,0.0,0.0,0.0,1.0]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"_FEATURE_ID_0":3},"indices":4,
"extensions":{"KHR_draco_mesh_compression":{"bufferView":0,"attributes":{"POSITION":3,"NORMAL":2,"TEXCOORD_0":1,
"_FEATURE_ID_0":0}},"EXT_mesh_features":{"featureIds":[{"attribute":0,"featureCount":1}]}},"material":0}]}],
"materials":[{"doubleSided":true,"pbrMetallicRoughness":{"metallicFactor":0.0,"roughnessFactor":1.0,
"baseColorFactor":[1.0,1.0,1.0,1.0],"baseColorTexture":{"index":0}}}],"textures":[{"source":0}],
"images":[{"uri":"../texture/
"}],"textures":[{"source":0}],"images":[{"uri":"../../../../texture/
"}],"accessors":[{"componentType":5126,"type":"VEC3","count":4,"min":[0,0,0],"max":[64,64,0.001]},
{"componentType":5126,"type":"VEC3","count":4},{"componentType":5126,"type":"VEC2","count":4},{"componentType":5123,
"type":"SCALAR","count":4},{"componentType":5125,"type":"SCALAR","count":6},{"componentType":5125,"type":"SCALAR",
"count":1,"bufferView":1},{"componentType":5126,"type":"MAT4","count":1,"bufferView":2},{"componentType":5125,
"type":"SCALAR","count":1,"bufferView":3},{"componentType":5126,"type":"MAT4","count":1,"bufferView":4},
{"componentType":5125,"type":"SCALAR","count":1,"bufferView":5},{"componentType":5126,"type":"MAT4","count":1,
"bufferView":6},{"componentType":5125,"type":"SCALAR","count":1,"bufferView":7}],"bufferViews":[{"buffer":0,
"byteLength":209},{"buffer":0,"byteLength":4,"byteOffset":212},{"buffer":0,"byteLength":64,"byteOffset":216},
{"buffer":0,"byteLength":4,"byteOffset":280},{"buffer":0,"byteLength":64,"byteOffset":284},{"buffer":0,"byteLength":4,
"byteOffset":348},{"buffer":0,"byteLength":128,"byteOffset":352},{"buffer":0,"byteLength":8,"byteOffset":
}],"buffers":[{"byteLength":216}],"scenes":[{"nodes":[0],"extras":{"farfield":{"cell":"0/0/0/0","objects":5,
"instances":[{"mesh":"","transforms":6,"objects":7},{"mesh":"","transforms":8,"objects":9}]}}}]}\x20\x20\x20
\xd8\x00\x00\x00BIN\x00DRACO\x02\x02\x01\x01\x00\x00\x00\x04\x02\x03\x02\x00\x00\x01\x1f\xff\x01\x11\xff\x01\x11\xff\x01
\x11\xff\x01\x11\x04\x02\x00\x00\xff\x00\x00\x00\x00\x00\x01\x00\x00\x01\x04\x04\x01\x00\x00\x01\x01\x00\x09\x03\x00\x03
\x02\x01\x03\x09\x02\x01\x01\x02\x01\x01\x09\x03\x00\x02\x03\x01\x01\x01\x01\x01\x01\x01\x40\x01\x00\x00\x00\x00\x00\x00
\x00\x00\x00\x01\x01\x01\x00\x10
\x03\x01\x20\x01\x10\x2f\x01\x10\x03\x00\xec\x8f\x00\x80\x00\x00\xb1\x38\x11\x00\x00\x00\x00\x00\xff\xff\x00\x00\x00\x00
\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x80\x42\x10\x05\x01\x01\x00\x03
\x03\x30\x01\x10\x03\x00\x24\x82\x26\x00\x02\x00\x00\x00\x80\x02\x80\x70\x00\x00\x00\x00\xff\x3f\x00\x00\x00\x00\x00\x00
\x00\x00\x00\x00\x00\x00\x00\x41\x0e\x06\x03\x01\x01\x01\x01\x01\x40\x01\x00\xff\x00\x00\x00\x7f\x00\x00\x00\xff\x02\x44
\x40\x08\x00\x00\x00\x01
# A mesh of one colour, and a leaf of such ground with instances.
\x00\x00\x80\x3f\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x80\x3f\x00\x00\x00\x00\x00\x00
\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x80\x3f\x00\x00\x00\x00
,"objects":4,"instances":[{"mesh":"","transforms":5,"objects":6},{"mesh":"","transforms":7,
"objects":8}]}}}]}\x20\x20\x20
"instances":[]}}}]}\x20\x20\x20
glTF\x02\x00\x00\x00\x00\x03\x00\x00\x40\x04\x00\x00JSON{"asset":{"version":"2.0","generator":"farfield"},
"extensionsUsed":["EXT_mesh_features","KHR_draco_mesh_compression"],
"extensionsRequired":["KHR_draco_mesh_compression"],"scene":0,"nodes":[{"mesh":0,
"matrix":[1.0,0.0,0.0,0.0,0.0,0.0,-1.0,0.0,0.0,1.0,0.0,0.0,0.0,0.0,0.0,1.0]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1,"_FEATURE_ID_0":2},"indices":3,
"extensions":{"KHR_draco_mesh_compression":{"bufferView":0,"attributes":{"POSITION":2,"NORMAL":1,"_FEATURE_ID_0":0}},
"EXT_mesh_features":{"featureIds":[{"attribute":0,"featureCount":1}]}},"material":0}]}],
"materials":[{"doubleSided":true,"pbrMetallicRoughness":{"metallicFactor":0.0,"roughnessFactor":1.0,
"baseColorFactor":[0.5,0.5,0.5,1.0]}}],"accessors":[{"componentType":5126,"type":"VEC3","count":100,
"min":[-0.5,-0.5,0],"max":[0.
]},{"componentType":5126,"type":"VEC3","count":100},{"componentType":5123,"type":"SCALAR","count":100},
{"componentType":5125,"type":"SCALAR","count":100}],"bufferViews":[{"buffer":0,"byteLength":100}],
"buffers":[{"byteLength":100}],"scenes":[{"nodes":[0]}]}\x20\x20\x20
\x0d\x03\x01\x20\x27\x01\x20\x03\x00\xd8\x83\x00\x18\x00\x00\x18\x80\x02\x00\x00\x02\x00\x00\x00\x00\xff\xff\x00\x00\x00
\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x41\x10\x06\x03\x01\x01\x01\x01\x01\x40\x01
\x00\x00\x00\x00\xff\x07\x00\x00
\x3f\x00\x00\x00\x1f\x00\x00\x00\xff\x02\xff\x00\x00\x00\x7f\x00\x00\x00\xff\x02\x44\x40\x08\x00
\x00\x00\x00\x00BIN\x00DRACO\x02\x02\x01\x01\x00\x00\x00\x04\x02\x02\x02\x00\x00\x01\x1f\xff\x01\x11\xff\x01\x11\xff\x01
\x11\x03\x01\x00\x00\xff\x00\x00\x00\x00\x00\x01\x04\x04\x01\x00\x00\x01\x01\x00\x09\x03\x00\x02\x02\x01\x01\x09\x03\x00
\x01\x03\x01\x01\x01\x01\x01\x01\x01\x40\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x01\x01\x01\x00\x10\x03\x03\x03\x01\x13
\x00\x11\x00\x30\x02\x48\x25\x30
`;

/** The bytes of a dictionary as text: lines but for those that begin with #, without their ends; \xNN is a byte. */
function parsed(text: string): Uint8Array {
  const joined = text.split("\n").filter((line) => !line.startsWith("#")).join("");
  const letters = joined.replace(/\\x(..)/g, (_, digits: string) => String.fromCharCode(parseInt(digits, 16)));
  return Uint8Array.from(letters, (letter) => letter.charCodeAt(0));
}

/** What GLBs of near geometry are deflated with (spec/world.md, Dictionary). */
export const DICTIONARY = parsed(DICTIONARY_TEXT);
