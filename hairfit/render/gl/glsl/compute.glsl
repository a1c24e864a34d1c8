#version 430
layout(local_size_x = GROUP) in;
uniform uint count;
