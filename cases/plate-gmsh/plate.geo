// A square plate of zero thickness in a box of air: gmsh -3 plate.geo -o plate.msh
SetFactory("OpenCASCADE");
Box(1) = {-3, -3, -3, 6, 6, 8};
Rectangle(100) = {-0.5, -0.5, 0, 1, 1};
// The plate becomes a face inside the volume, with the nodes of the cells on both sides.
BooleanFragments{ Volume{1}; Delete; }{ Surface{100}; Delete; }

plate() = Surface In BoundingBox{-0.51, -0.51, -0.01, 0.51, 0.51, 0.01};
outlet() = Surface In BoundingBox{-3.1, -3.1, 4.9, 3.1, 3.1, 5.1};
all() = Surface In BoundingBox{-3.1, -3.1, -3.1, 3.1, 3.1, 5.1};
corner() = Point In BoundingBox{-0.51, -0.51, -0.01, -0.49, -0.49, 0.01};
rest() = all(); rest() -= plate(); rest() -= outlet();

Physical Volume("air") = {Volume{:}};
Physical Surface("canopy") = plate();
Physical Surface("outlet") = outlet();
Physical Surface("outer air") = rest();
Physical Point("fixed") = corner();

Field[1] = Distance; Field[1].SurfacesList = {plate()};
Field[2] = Threshold; Field[2].InField = 1;
Field[2].SizeMin = 0.13; Field[2].SizeMax = 1; Field[2].DistMin = 0.2; Field[2].DistMax = 2.6;
Background Field = 2;
Mesh.MeshSizeExtendFromBoundary = 0;
Mesh.MeshSizeFromPoints = 0;
Mesh.Optimize = 1;
Mesh.MshFileVersion = 4.1;
