"""One frame to pose and map: Pipeline, Mapper, SemanticSlam, configuration, session."""
